"""The network of a learned policy: one network scores every choice from its features and those of the others. Needs PyTorch."""

from __future__ import annotations

from typing import Any

import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import nn

WIDTH = 48
"""Units of a hidden layer."""


class ChoiceNetwork(nn.Module):
    """Maps features (n, choices · parts) to logits (n, choices) of the actor and to features (n, WIDTH) of the critic."""

    def __init__(self, choices: int, parts: int) -> None:
        super().__init__()
        self.shape = choices, parts
        self.latent_dim_pi, self.latent_dim_vf = choices, WIDTH
        last = nn.Linear(WIDTH, 1)
        # Small weights make all choices about equally probable at first.
        nn.init.normal_(last.weight, std=0.01)
        # The names of these modules are keys of saved models.
        self.each = nn.Sequential(nn.Linear(3 * parts, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh(), last)
        self.moment = nn.Sequential(nn.Linear(3 * parts, WIDTH), nn.Tanh(), nn.Linear(WIDTH, WIDTH), nn.Tanh())

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        rows = features.reshape(-1, *self.shape)
        beside = torch.cat([rows[:, :1], rows.amax(dim=1, keepdim=True)], dim=2).expand(-1, self.shape[0], -1)
        return self.each(torch.cat([rows, beside], dim=2)).squeeze(2)

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        rows = features.reshape(-1, *self.shape)
        return self.moment(torch.cat([rows[:, 0], rows.amax(dim=1), rows.mean(dim=1)], dim=1))


class ChoicePolicy(ActorCriticPolicy):
    """Actor and critic over a flat observation of `choices` rows of `parts` features."""

    mlp_extractor: Any

    def __init__(self, *args: Any, choices: int, parts: int, **options: Any) -> None:
        self._rows = choices, parts
        super().__init__(*args, **options)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        return super()._get_constructor_parameters() | {"choices": self._rows[0], "parts": self._rows[1]}

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = ChoiceNetwork(*self._rows)

    def _build(self, lr_schedule: Any) -> None:
        self.ortho_init = False
        super()._build(lr_schedule)
        self.action_net = nn.Identity()
        self.optimizer = torch.optim.Adam(self.parameters(), lr=lr_schedule(1), eps=1e-5)
