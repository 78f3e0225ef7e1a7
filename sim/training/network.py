"""The network: a residual trunk to stride 32, a top-down pathway (Lin et al. 2017), and one head at stride 4. Needs torch.

Bottlenecks keep the cost low: about 2·10⁹ multiplications for 768 x 576 px.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

TRUNK: tuple[tuple[int, int], ...] = ((32, 1), (64, 2), (96, 3), (128, 3))
"""Channels and residual blocks at strides 4, 8, 16 and 32."""
STEM, WIDTH = 16, 48
"""Channels at stride 2, and of the top-down pathway and of the head."""
PRIOR = 0.01
"""Score of every cell before training (Lin et al. 2017, focal loss)."""
EDGES = 4
PIXEL_SCALE = 1 / 64
"""Images x in 0..1 are normalized to (x − 0.45) · 255 / 64."""


class _ConvBlock(nn.Sequential):
    """A convolution without bias, batch normalization and, if asked for, a rectifier."""

    def __init__(self, inputs: int, outputs: int, kernel: int, stride: int = 1, rectified: bool = True) -> None:
        parts: list[nn.Module] = [nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False), nn.BatchNorm2d(outputs)]
        super().__init__(*parts, *([nn.ReLU(inplace=True)] if rectified else []))


class _Bottleneck(nn.Module):
    """A residual block: 1 x 1 to half the channels, then 3 x 3."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.inner = nn.Sequential(_ConvBlock(channels, channels // 2, 1), _ConvBlock(channels // 2, channels, 3, rectified=False))
        self.rectifier = nn.ReLU(inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        return self.rectifier(x + self.inner(x))


class PersonNetwork(nn.Module):
    """image (n, 3, H, W) RGB in 0..1, H and W multiples of 32 → scores (n, 1, H/4, W/4), edges, spread and hidden (n, 4, H/4, W/4).

    scores: logits of a body's centre. edges: natural logarithms of the distances (px) from the cell's centre to left, top, right and bottom of the
    whole body. spread: natural logarithms of the mean absolute errors of `edges`.
    hidden: logits of the shares of the box beyond the visible part at left, top, right and bottom.
    """

    def __init__(self) -> None:
        super().__init__()
        stages, laterals, inputs = [], [], STEM
        for channels, blocks in TRUNK:
            stages.append(nn.Sequential(_ConvBlock(inputs, channels, 3, 2), *(_Bottleneck(channels) for _ in range(blocks))))
            laterals.append(_ConvBlock(channels, WIDTH, 1, rectified=False))
            inputs = channels
        self.stem = _ConvBlock(3, STEM, 3, 2)
        self.stages, self.laterals = nn.ModuleList(stages), nn.ModuleList(laterals)
        self.smoothing = nn.ModuleList([_ConvBlock(WIDTH, WIDTH, 3) for _ in TRUNK[1:]])
        self.rise = nn.Upsample(scale_factor=2, mode="nearest")
        self.head = _ConvBlock(WIDTH, WIDTH, 3)
        self.outputs = nn.Conv2d(WIDTH, 1 + 3 * EDGES, 1)
        self._initialize()

    def _initialize(self) -> None:
        for part in self.modules():
            if isinstance(part, nn.Conv2d):
                nn.init.kaiming_normal_(part.weight, mode="fan_out", nonlinearity="relu")
        with torch.no_grad():
            self.outputs.weight.mul_(0.1)
            bias = self.outputs.bias
            assert bias is not None
            bias.zero_()
            bias[0] = -math.log((1 - PRIOR) / PRIOR)
            # A body of about 60 x 24 px.
            bias[1 : 1 + EDGES] = torch.tensor([12.0, 30.0, 12.0, 30.0]).log()
            bias[1 + EDGES : 1 + 2 * EDGES] = -1.0
            bias[1 + 2 * EDGES :] = -3.0

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        x = self.stem((image - 0.45) * (255 * PIXEL_SCALE))
        levels = []
        for stage in self.stages:
            x = stage(x)
            levels.append(x)
        rising = self.laterals[-1](levels[-1])
        for k in range(len(levels) - 2, -1, -1):
            rising = self.laterals[k](levels[k]) + self.rise(self.smoothing[k](rising))
        found = self.outputs(self.head(torch.relu(rising)))
        scores, edges, spread, hidden = found.split([1, EDGES, EDGES, EDGES], dim=1)
        return scores, edges, spread, hidden


def parameter_count(network: nn.Module) -> int:
    """The number of trained values."""
    return sum(part.numel() for part in network.parameters())
