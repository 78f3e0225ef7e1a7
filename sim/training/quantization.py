"""Weights and activations of the network in 8 bits, as onnxruntime runs them (Jacob et al. 2018). Needs the extra `train`.

Sums of 8-bit products are whole numbers, so that they do not depend on their order, the number of threads or the processor.
Floating-point convolutions do. Weights have 7 bits, because processors without VNNI add two products in 16 bits.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray

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
