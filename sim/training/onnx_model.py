"""Export of the network as ONNX with its calibration in the metadata. Needs the extra `train`."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from sim.training.quantization import quantize
from tracker.io.atomic import new_file

OPSET = 17
KEY = "pilsim"
"""Entry of the metadata: a JSON object with version, calibration, min_score and nms_iou, and how the model was made."""
OUTPUTS = ("scores", "edges", "spread")


class _Exported(nn.Module):
    """The network with its spread as a share of the height of the box."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        scores, edges, spread = self.network(image)
        distance = edges.clamp(-3.0, 8.0).exp()
        height = distance[:, 1:2] + distance[:, 3:4]
        return scores, edges, spread + edges - height.log()


def export(network: nn.Module, file: Path, pictures: Iterable[NDArray[np.uint8]]) -> None:
    """Write the quantized network. Input and outputs: as PersonNetwork; spread is the logarithm of a Laplace scale over the height.

    pictures: (b, H, W, 3) RGB, which decide the ranges of activations. `describe` adds the metadata.
    """
    sides = {name: {2: "height", 3: "width"} if name == "image" else {2: f"{name}_rows", 3: f"{name}_columns"} for name in ("image", *OUTPUTS)}
    with new_file(file) as part, TemporaryDirectory() as folder:
        exact = Path(folder) / "exact.onnx"
        with warnings.catch_warnings():
            # The exporter by tracing is the one that gives a plain graph, and says that another one exists.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                _Exported(network.eval()), (torch.zeros(1, 3, 64, 64),), exact, dynamo=False, opset_version=OPSET,
                input_names=["image"], output_names=list(OUTPUTS), dynamic_axes=sides,
            )  # fmt: skip
        quantize(exact, part, pictures)


def describe(file: Path, entry: dict[str, Any]) -> None:
    """Set the metadata of a model. entry: JSON values."""
    import onnx

    model = onnx.load(file)
    onnx.helper.set_model_props(model, {KEY: json.dumps(entry)})
    with new_file(file) as part:
        onnx.save(model, part)
