"""The loss of the network: focal loss of the centres, and errors of the edges. Needs torch.

Focal loss: Law & Deng 2018 (CornerNet), equation 1. Overlap: generalized IoU, Rezatofighi et al. 2019.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

FOCUS, NEARBY = 2.0, 4.0
"""Exponents of the focal loss, and of the discount of cells near a centre."""
LOGARITHM = (0.3, 0.3, 0.3, 0.45)
"""Weights of the absolute errors of the logarithms of left, top, right and bottom, beside the overlap. Feet decide where a person stands."""
SPREAD_WEIGHT = 0.05


def detection_loss(outputs: tuple[Tensor, Tensor, Tensor], targets: dict[str, Tensor]) -> dict[str, Tensor]:
    """Parts of the loss, to be summed: scores, overlap, logarithm and spread. targets: as in CropBatch, with the same names."""
    scores, edges, spread = (output.float() for output in outputs)
    heat, counted, weight = targets["heat"], targets["counted"], targets["weight"]
    centre = (heat == 1).float()
    count = centre.sum().clamp(min=4.0)
    probability = torch.sigmoid(scores)
    found = functional.logsigmoid(scores) * (1 - probability) ** FOCUS * centre
    empty = functional.logsigmoid(-scores) * probability**FOCUS * (1 - heat) ** NEARBY * (1 - centre) * counted
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
    }


def generalized_iou(a: Tensor, b: Tensor) -> Tensor:
    """Generalized IoU (n, 1, h, w) of boxes around the same points, given by distances (n, 4, h, w) to left, top, right and bottom."""
    inner, outer = torch.minimum(a, b), torch.maximum(a, b)
    common = (inner[:, 0] + inner[:, 2]) * (inner[:, 1] + inner[:, 3])
    hull = (outer[:, 0] + outer[:, 2]) * (outer[:, 1] + outer[:, 3])
    area_a, area_b = ((d[:, 0] + d[:, 2]) * (d[:, 1] + d[:, 3]) for d in (a, b))
    union = area_a + area_b - common
    return (common / union - (hull - union) / hull)[:, None]
