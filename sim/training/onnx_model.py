"""Export of the network as ONNX with its calibration in the metadata. Needs the extra `train`."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

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


def export(network: nn.Module, file: Path, entry: dict[str, Any]) -> None:
    """Write the network with its metadata. Input and outputs: as PersonNetwork; spread is the logarithm of a Laplace scale over the height.

    entry: JSON values of the metadata.
    """
    import onnx

    sides = {name: {2: "height", 3: "width"} if name == "image" else {2: f"{name}_rows", 3: f"{name}_columns"} for name in ("image", *OUTPUTS)}
    with new_file(file) as part:
        with warnings.catch_warnings():
            # The exporter by tracing is the one that gives a plain graph, and says that another one exists.
            warnings.simplefilter("ignore")
            torch.onnx.export(
                _Exported(network.eval()), (torch.zeros(1, 3, 64, 64),), part, dynamo=False, opset_version=OPSET,
                input_names=["image"], output_names=list(OUTPUTS), dynamic_axes=sides,
            )  # fmt: skip
        model = onnx.load(part)
        assert [one.name for one in model.graph.output] == list(OUTPUTS)
        onnx.helper.set_model_props(model, {KEY: json.dumps(entry)})
        onnx.save(model, part)
