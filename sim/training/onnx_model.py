"""Export of the network as ONNX in 8 bits (Jacob et al. 2018) with its calibration in the metadata. Needs the extra `train`.

Sums of 8-bit products are whole numbers, so that they do not depend on their order, the number of threads or the processor.
Floating-point convolutions do. Weights have 7 bits, because processors without VNNI add two products in 16 bits.
"""

from __future__ import annotations

import json
import logging
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from tracker.io.atomic import new_file

LAST = "outputs"
"""Name of the last convolution, whose channels are the outputs."""
EXACT = ("Exp", "Log", "Clip", "Slice", "Sub")
"""Operations that stay in floating point, besides the last convolution: they make logits and distances, whose range is large."""


def quantize(graph: Path, out: Path, pictures: Iterable[NDArray[np.uint8]]) -> None:
    """Write an ONNX graph in floating point as one with quantized convolutions, sums and magnifications.

    pictures: (b, H, W, 3) RGB; the least and the largest value of each activation on them is its range. Scales of weights are by channel.
    """
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    class _Pictures(CalibrationDataReader):
        """One picture after another, as the network takes them."""

        def __init__(self) -> None:
            self._images: Iterator[NDArray[np.uint8]] = (picture for batch in pictures for picture in batch)

        def get_next(self) -> dict[str, NDArray[np.float32]] | None:
            picture = next(self._images, None)
            if picture is None:
                return None
            return {"image": np.ascontiguousarray(picture.transpose(2, 0, 1)[None], np.float32) / np.float32(255)}

    quiet = logging.getLogger()
    with TemporaryDirectory() as folder:
        prepared = Path(folder) / "prepared.onnx"
        level = quiet.level
        quiet.setLevel(logging.ERROR)
        try:
            quant_pre_process(graph, prepared, skip_symbolic_shape=True)
            nodes = onnx.load(prepared).graph.node
            last = [node.name for node in nodes if node.op_type == "Conv"][-1]
            quantize_static(
                prepared, out, _Pictures(), quant_format=QuantFormat.QDQ, per_channel=True, reduce_range=True,
                activation_type=QuantType.QUInt8, weight_type=QuantType.QInt8,
                nodes_to_exclude=[last, *(node.name for node in nodes if node.op_type in EXACT)],
            )  # fmt: skip
        finally:
            quiet.setLevel(level)


def take_weights(network: nn.Module, file: Path, pictures: Iterable[NDArray[np.uint8]]) -> None:
    """Give a network the weights of an exported model, so that its outputs agree up to the rounding to 8 bits.

    Export has folded the normalizations into the convolutions. They are restored with the means and variances of channels on pictures
    (b, H, W, 3) RGB, so that training continues from the model. Outputs that an older model lacks keep their initial weights.
    Raises ValueError for a model of other shapes.
    """
    found, parts = _convolutions(file), dict(network.named_modules())
    plain = {name: part for name, part in parts.items() if isinstance(part, nn.Conv2d)}
    ours, theirs = {name: part.weight.shape for name, part in plain.items()}, {name: weight.shape for name, (weight, _) in found.items()}
    outputs, known = ours.pop(LAST), theirs.pop(LAST, None)
    if ours != theirs or known is None or known[1:] != outputs[1:] or known[0] > outputs[0]:
        raise ValueError(f"{file}: has other convolutions than the network that is trained")
    moments: dict[nn.Module, list[Tensor]] = {}
    with torch.no_grad():
        for name, part in plain.items():
            weight, bias = found[name]
            part.weight[: len(weight)].copy_(weight)
            if part.bias is not None:
                part.bias[: len(bias)].copy_(bias)
                continue
            block, _, last = name.rpartition(".")
            norm: Any = parts[f"{block}.{int(last) + 1}"]
            norm.running_mean.zero_()
            norm.running_var.fill_(1.0 - norm.eps)
            norm.weight.fill_(1.0)
            norm.bias.copy_(bias)
            moments[norm] = []
        hooks = [norm.register_forward_pre_hook(lambda norm, x: moments[norm].append(_moments(x[0]))) for norm in moments]
        for batch in pictures:
            network.eval()(torch.from_numpy(batch).permute(0, 3, 1, 2).float().div(255.0))
        for hook in hooks:
            hook.remove()
        for norm, seen in moments.items():
            mean, square = torch.stack(seen).mean(dim=0)
            norm.running_mean.copy_(mean)
            norm.running_var.copy_(square - mean**2)
            norm.weight.copy_((square - mean**2 + norm.eps).sqrt())
            norm.bias.add_(mean)


def _moments(x: Tensor) -> Tensor:
    """Means of the channels of x (n, c, h, w) and of their squares, (2, c)."""
    return torch.stack([x.mean(dim=(0, 2, 3)), (x**2).mean(dim=(0, 2, 3))])


def _convolutions(file: Path) -> dict[str, tuple[Tensor, Tensor]]:
    """Name of each convolution of an exported model, which is that of its module → its weights and its bias in floating point."""
    import onnx

    graph = onnx.load(file).graph
    values = {one.name: onnx.numpy_helper.to_array(one) for one in graph.initializer}
    for node in graph.node:
        if node.op_type == "DequantizeLinear" and node.input[0] in values:
            scale = values[node.input[1]]
            # Each output channel has a scale of its own.
            scale = scale.reshape(-1, *[1] * (values[node.input[0]].ndim - 1)) if scale.size > 1 else scale
            values[node.output[0]] = values[node.input[0]].astype(np.float32) * scale
    out = {}
    for node in graph.node:
        if node.op_type == "Conv":
            # A node's name holds those of the modules around it, as /network/stages.0/stages.0.1/inner/inner.0/Conv.
            path = node.name.split("/")[2:-1]
            name = ".".join(part for part, inner in zip(path, [*path[1:], ""], strict=True) if not inner.startswith(f"{part}."))
            weight, bias = (torch.from_numpy(np.array(values[of])) for of in node.input[1:3])
            out[name] = weight, bias
    return out


OPSET = 17
KEY = "pilsim"
"""Entry of the metadata: a JSON object with version, calibration, min_score and nms_iou, and how the model was made."""
OUTPUTS = ("scores", "edges", "spread", "hidden")


class _Exported(nn.Module):
    """The network with its spread as a share of the height of the box."""

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        scores, edges, spread, hidden = self.network(image)
        distance = edges.clamp(-3.0, 8.0).exp()
        height = distance[:, 1:2] + distance[:, 3:4]
        return scores, edges, spread + edges - height.log(), hidden


def export(network: nn.Module, file: Path, pictures: Iterable[NDArray[np.uint8]]) -> None:
    """Write the quantized network. Input and outputs: as PersonNetwork; spread is the logarithm of a Laplace scale over the height.

    pictures: (b, H, W, 3) RGB, which decide the ranges of activations. `describe` adds the metadata.
    """
    sides = {name: {2: "height", 3: "width"} if name == "image" else {2: f"{name}_rows", 3: f"{name}_columns"} for name in ("image", *OUTPUTS)}
    with new_file(file) as part, TemporaryDirectory() as folder:
        exact = Path(folder) / "exact.onnx"
        with warnings.catch_warnings():
            # Only the tracing exporter gives a plain graph. It warns that a newer exporter exists.
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
