"""Optimization of the network: its loss, batches made in other processes, AdamW with a cosine schedule, averaged weights, checkpoints. Needs torch.

The loss is a focal loss of the centers (Law & Deng 2018, CornerNet, equation 1) and errors of the edges.
Overlap is the generalized IoU of Rezatofighi et al. 2019.
"""

from __future__ import annotations

import copy
import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from sim.training.augmentation import CropSampler
from sim.training.network import PersonNetwork
from sim.training.onnx_model import take_weights
from tracker.io.atomic import new_file
from tracker.io.progress import progress_bar

FOCUS, NEARBY = 2.0, 4.0
"""Exponents of the focal loss, and of the discount of cells near a centre."""
LOGARITHM = (0.3, 0.3, 0.3, 0.45)
"""Weights of the absolute errors of the logarithms of left, top, right and bottom, beside the overlap. Feet decide where a person stands."""
SPREAD_WEIGHT, HIDDEN_WEIGHT = 0.05, 0.4


def detection_loss(outputs: tuple[Tensor, ...], targets: dict[str, Tensor]) -> dict[str, Tensor]:
    """Parts of the loss, to be summed: scores, overlap, logarithm, spread and hidden. targets: stacked, under the names of Targets."""
    scores, edges, spread, hidden = (output.float() for output in outputs)
    heat, counted, weight = targets["heat"], targets["counted"], targets["weight"]
    centre = targets["worth"]
    count = centre.sum().clamp(min=4.0)
    probability = torch.sigmoid(scores)
    found = functional.logsigmoid(scores) * (1 - probability) ** FOCUS * centre
    empty = functional.logsigmoid(-scores) * probability**FOCUS * (1 - heat) ** NEARBY * counted
    total = weight.sum().clamp(min=4.0)
    wanted = targets["edges"]
    errors = (edges - wanted.log()).abs()
    scaled = torch.tensor(LOGARITHM).view(1, 4, 1, 1)
    # The spread learns the size of the errors without changing them: a Laplace distribution whose error is detached.
    spreading = errors.detach() * torch.exp(-spread) + spread
    return {
        "scores": -(found.sum() + empty.sum()) / count,
        "overlap": ((1 - generalized_iou(edges.clamp(-3.0, 7.5).exp(), wanted)) * weight).sum() / total,
        "logarithm": (errors * scaled * weight).sum() / total,
        "spread": SPREAD_WEIGHT * (spreading * weight).sum() / total,
        # The cross entropy of a share is least at its mean.
        "hidden": HIDDEN_WEIGHT * (functional.binary_cross_entropy_with_logits(hidden, targets["hidden"], reduction="none") * weight).sum() / total,
    }


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """Generalized IoU (n, 1, h, w) of boxes around the same points, given by distances (n, 4, h, w) to left, top, right and bottom."""
    inner, outer = torch.minimum(a, b), torch.maximum(a, b)
    common = (inner[:, 0] + inner[:, 2]) * (inner[:, 1] + inner[:, 3])
    hull = (outer[:, 0] + outer[:, 2]) * (outer[:, 1] + outer[:, 3])
    area_a, area_b = ((d[:, 0] + d[:, 2]) * (d[:, 1] + d[:, 3]) for d in (a, b))
    union = area_a + area_b - common
    return (common / union - (hull - union) / hull)[:, None]


RATE, TUNING_RATE, WARM_UP, DECAY = 2e-3, 8e-4, 200, 0.02
"""Largest learning rates from random weights and from a trained model, steps until they are reached, and weight decay."""
START_BATCHES = 12
"""Batches whose statistics normalize the channels of a trained model."""
AVERAGE = 0.998
"""Decay of the moving average of the weights, which is the result (Polyak & Juditsky 1992)."""
LARGEST_GRADIENT = 10.0
SAVED_EVERY, ROW_EVERY = 250, 50
"""Steps between checkpoints, and between rows of the curve."""
PARTS = ("scores", "overlap", "logarithm", "spread", "hidden")
CHECKPOINT, CURVE = "checkpoint.pt", "curve.csv"


@dataclass(eq=False)
class TrainingState:
    """All that a checkpoint holds.

    network, average: the trained and the averaged one. step: number of the next batch. rows: of the curve, step and parts of the loss.
    """

    network: nn.Module
    average: nn.Module
    optimizer: torch.optim.Optimizer
    step: int = 0
    rows: list[tuple[float, ...]] = field(default_factory=list)

    @staticmethod
    def new(seed: int) -> TrainingState:
        torch.manual_seed(seed)
        network: Any = PersonNetwork()
        network = network.to(memory_format=torch.channels_last)
        decayed = [part for part in network.parameters() if part.ndim > 1]
        plain = [part for part in network.parameters() if part.ndim <= 1]
        groups = [{"params": decayed, "weight_decay": DECAY}, {"params": plain, "weight_decay": 0.0}]
        return TrainingState(network, copy.deepcopy(network), torch.optim.AdamW(groups, lr=RATE))

    def save(self, file: Path) -> None:
        """Write the checkpoint, and replace an existing one."""
        parts = {"network": self.network.state_dict(), "average": self.average.state_dict(), "optimizer": self.optimizer.state_dict()}
        with new_file(file) as part:
            torch.save(parts | {"step": self.step, "rows": self.rows}, part)

    @staticmethod
    def read(file: Path, seed: int) -> TrainingState:
        """The state of a checkpoint."""
        content, state = torch.load(file, weights_only=True), TrainingState.new(seed)
        for name in ("network", "average", "optimizer"):
            getattr(state, name).load_state_dict(content[name])
        state.step, state.rows = int(content["step"]), [tuple(row) for row in content["rows"]]
        return state


class _Batches(torch.utils.data.Dataset):
    """The batches of a sampler as tensors, by their number."""

    def __init__(self, sampler: CropSampler) -> None:
        self._sampler = sampler

    def __getitem__(self, number: int) -> dict[str, Tensor]:
        return {name: torch.from_numpy(values) for name, values in self._sampler.batch(number).items()}


def optimize(sampler: CropSampler, steps: int, folder: Path, workers: int, start: Path | None = None) -> nn.Module:
    """Train for `steps` batches, and return the averaged network.

    It continues from a checkpoint in `folder`, and writes checkpoints and curve.csv there. start: a model whose weights are the initial ones.
    workers: number of processes that make batches; the result is the same with any number. The network is trained in one thread.
    """
    torch.set_num_threads(1)
    file = folder / CHECKPOINT
    state = TrainingState.read(file, sampler.seed) if file.exists() else TrainingState.new(sampler.seed)
    if start is not None and not file.exists():
        take_weights(state.network, start, (sampler.batch(steps + k)["picture"] for k in range(START_BATCHES)))
        state.average = copy.deepcopy(state.network)
    largest = RATE if start is None else TUNING_RATE
    state.network.train()
    recent: list[list[float]] = []
    with progress_bar(total=steps, initial=state.step, desc="training", unit="step") as bar:
        for batch in _loaded(sampler, range(state.step, steps), workers):
            recent.append(_step(state, batch, learning_rate(state.step, steps, largest)))
            state.step += 1
            bar.update(1)
            if state.step % ROW_EVERY == 0 or state.step == steps:
                state.rows.append((state.step, *np.mean(recent, axis=0).tolist()))
                recent = []
                bar.set_postfix(loss=f"{sum(state.rows[-1][1:]):.3f}")
            if state.step % SAVED_EVERY == 0 or state.step == steps:
                state.save(file)
                write_curve(state.rows, folder / CURVE)
    return state.average.eval()


def _loaded(sampler: CropSampler, numbers: range, workers: int) -> Iterator[dict[str, Tensor]]:
    # A fork would inherit locks of the threads that OpenCV and onnxruntime have, and deadlock.
    processes: dict[str, Any] = {"num_workers": workers, "worker_init_fn": _one_thread, "prefetch_factor": 8, "multiprocessing_context": "spawn"}
    if not workers:
        _one_thread(0)
    loader: Any = torch.utils.data.DataLoader(_Batches(sampler), batch_size=None, sampler=list(numbers), **(processes if workers else {}))
    return iter(loader)


def _one_thread(_: int) -> None:
    import cv2

    cv2.setNumThreads(1)


def learning_rate(step: int, steps: int, largest: float = RATE) -> float:
    """The rate of a step: linear to the largest over WARM_UP steps, then half a cosine to 0 (Loshchilov & Hutter 2017)."""
    warm = min(WARM_UP, max(1, steps // 5))
    if step < warm:
        return largest * (step + 1) / warm
    return largest * 0.5 * (1 + math.cos(math.pi * (step - warm) / max(1, steps - warm)))


def _step(state: TrainingState, batch: dict[str, Tensor], rate: float) -> list[float]:
    """One step of the optimizer. Returns the parts of the loss."""
    for group in state.optimizer.param_groups:
        group["lr"] = rate
    picture = batch["picture"].permute(0, 3, 1, 2).float().div(255.0)
    with torch.autocast("cpu", torch.bfloat16):
        outputs = state.network(picture)
    parts = detection_loss(outputs, batch)
    state.optimizer.zero_grad()
    torch.stack(list(parts.values())).sum().backward()
    nn.utils.clip_grad_norm_(state.network.parameters(), LARGEST_GRADIENT)
    state.optimizer.step()
    with torch.no_grad():
        decay = min(AVERAGE, (1 + state.step) / (10 + state.step))
        for name, value in state.average.state_dict().items():
            now = state.network.state_dict()[name]
            value.copy_(now) if not value.is_floating_point() else value.lerp_(now, 1 - decay)
    return [float(parts[name].detach()) for name in PARTS]


def write_curve(rows: list[tuple[float, ...]], file: Path) -> None:
    """Write the rows as CSV: step, and the mean of each part of the loss since the row before."""
    with new_file(file) as part, part.open("w", newline="", encoding="utf-8") as out:
        csv.writer(out).writerows([("step", *PARTS), *((int(row[0]), *(f"{value:.6g}" for value in row[1:])) for row in rows)])
