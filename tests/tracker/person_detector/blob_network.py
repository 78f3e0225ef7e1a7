"""A small network with known answers: a person is a bright blob of 12 px. Its box is 20 px wide and 94 px high, too high to be magnified."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from tracker.person_detector.search_levels import MAGNIFIED

BLOB, WIDTH, HEIGHT = 12, 20, round(MAGNIFIED[0]) + 4
META = {"version": 1, "calibration": [[-4, 0.0], [0, 0.5], [4, 1.0]], "min_score": 0.3, "nms_iou": 0.5}


def write_blob_network(
    path: Path,
    meta: dict[str, Any] | str | None = None,
    spread: float | None = None,
    outputs: tuple[str, ...] = (),
    height: int = HEIGHT,
    hidden: tuple[float, ...] = (),
) -> Path:
    """Write the network. meta: its metadata, a text as it is; "" for none. spread: of all edges. outputs: names in place of scores and edges.

    height: of the boxes, px. hidden: shares of all boxes beyond their visible parts, more than 0.
    """
    kernel, inner = np.full((1, 3, 28, 28), -1.0 / (3 * (28**2 - BLOB**2)), dtype=np.float32), slice(8, 8 + BLOB)
    kernel[:, :, inner, inner] = 1 / (3 * BLOB**2)
    names = outputs or ("scores", "edges")
    constant = {"edges": np.log([WIDTH / 2, height / 2, WIDTH / 2, height / 2])}
    if spread is not None:
        constant["spread"] = np.full(4, np.log(spread))
    if hidden:
        constant["hidden"] = np.log(np.array(hidden) / (1 - np.array(hidden)))
    nodes = [helper.make_node("Conv", ["image", "kernel", "offset"], [names[0]], strides=[4, 4], pads=[12, 12, 12, 12])]
    weights = [numpy_helper.from_array(10 * kernel, "kernel"), numpy_helper.from_array(np.array([-5], dtype=np.float32), "offset")]
    for name, values in constant.items():
        weights.append(numpy_helper.from_array(np.zeros((4, 3, 4, 4), dtype=np.float32), f"{name}_zero"))
        weights.append(numpy_helper.from_array(values.astype(np.float32), f"{name}_bias"))
        out = names[1] if name == "edges" else name
        nodes.append(helper.make_node("Conv", ["image", f"{name}_zero", f"{name}_bias"], [out], strides=[4, 4]))
    shape = ["one", "channels", "rows", "columns"]
    graph = helper.make_graph(
        nodes,
        "blobs",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "height", "width"])],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name in (*names, *list(constant)[1:])],
        weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    if meta != "":
        helper.set_model_props(model, {"pilsim": meta if isinstance(meta, str) else json.dumps(META | (meta or {}))})
    onnx.save(model, str(path))
    return path


def picture_with(size: tuple[int, int], blobs: list[tuple[float, float]], blob: int = BLOB) -> NDArray[np.uint8]:
    """A black picture (height, width of `size`) with bright squares about the middles (column, row), continued over the left and right edges."""
    image = np.zeros((*size, 3), dtype=np.uint8)
    for column, row in blobs:
        columns = np.arange(round(column - blob / 2), round(column + blob / 2)) % size[1]
        image[round(row - blob / 2) : round(row + blob / 2), columns] = 255
    return image
