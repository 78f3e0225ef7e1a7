"""The network of the person detector: an ONNX file with its calibration, run by onnxruntime.

Input `image`: float32 (1, 3, H, W), RGB in 0 to 1, H and W multiples of 32. Outputs at every fourth pixel:

* `scores` (1, 1, H/4, W/4): logits that the cell is the centre of a person.
* `edges` (1, 4, H/4, W/4): logarithms of the distances in px from the centre of the cell to the left, top, right and bottom of the whole body.
* `spread` (1, 4, H/4, W/4), optional: logarithms of the scale of a Laplace distribution of each edge, as a share of the height of the box.
* `hidden` (1, 4, H/4, W/4), optional: logits of the shares of the box beyond the visible part of the body at left, top, right and bottom.

The metadata of the file has an entry `pilsim`, a JSON object: version 1, `calibration` as pairs of logit and probability, `min_score` and `nms_iou`.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tracker.geometry import Array

KEY, VERSION = "pilsim", 1
STRIDE, MULTIPLE = 4, 32
"""px of a cell; sides of an input are multiples of MULTIPLE px."""
LARGEST_MODEL = 1 << 26
"""Largest size of a model file, bytes, because a file of unknown origin may fill the memory."""
CHANNELS = {"scores": 1, "edges": 4, "spread": 4, "hidden": 4}
"""Outputs and their channels."""

Maps = dict[str, NDArray[np.float32]]
"""Output → (channels, H/4, W/4)."""


def shipped_model() -> Path:
    """The model that is shipped with the package."""
    return Path(__file__).with_name("person_detector.onnx")


@dataclass(frozen=True, eq=False)
class ScoreCalibration:
    """The calibration of a model's scores, from its metadata.

    logit, probability (n,): corners of a monotone map of logits to the probability that a box is a person at an IoU of 0.5.
    min_score: least probability of a box. nms_iou: IoU above which two boxes are one person. Raises ValueError for values out of bounds.
    """

    logit: Array
    probability: Array
    min_score: float
    nms_iou: float

    def __post_init__(self) -> None:
        x, p = self.logit, self.probability
        if len(x) < 2 or not (np.isfinite(x).all() and np.isfinite(p).all() and (np.diff(x) > 0).all() and (np.diff(p) >= 0).all()):
            raise ValueError("calibration needs two pairs of numbers or more, logits growing, probabilities not falling")
        if not (p.min() >= 0 and p.max() <= 1):
            raise ValueError(f"calibration has probabilities {p.min():g} to {p.max():g}, needs 0 to 1")
        for name, value in (("min_score", self.min_score), ("nms_iou", self.nms_iou)):
            if not 0 <= value <= 1:
                raise ValueError(f"{name} is {value:g}, needs 0 to 1")

    @staticmethod
    def parse(text: str) -> ScoreCalibration:
        """From the JSON of a model's metadata. Raises ValueError for another content."""
        try:
            content = json.loads(text)
            if content["version"] != VERSION:
                raise ValueError(f"version is {str(content['version'])[:40]}, needs {VERSION}")
            corners = np.array(content["calibration"], dtype=np.float64).reshape(-1, 2)
            return ScoreCalibration(corners[:, 0], corners[:, 1], float(content["min_score"]), float(content["nms_iou"]))
        except (KeyError, TypeError, RecursionError, json.JSONDecodeError) as error:
            raise ValueError(f"{type(error).__name__} at {' '.join(str(error).split())[:80]}") from None

    def probabilities(self, logits: Array) -> Array:
        """Logits (n,) → probabilities (n,); constant beyond the first and the last corner."""
        return np.asarray(np.interp(logits, self.logit, self.probability))

    @property
    def least_logit(self) -> float:
        """A logit below which no box reaches min_score."""
        reached = np.flatnonzero(self.probability >= self.min_score)
        if not len(reached):
            return float("inf")
        k = int(reached[0])
        if k == 0:
            return float("-inf")
        return float(np.interp(self.min_score, self.probability[k - 1 : k + 1], self.logit[k - 1 : k + 1]))


class PersonNetwork:
    """A network that is loaded and checked.

    path: the ONNX file, None for the shipped one. threads: of one run; with 1, the same image gives the same bytes.
    Raises ValueError, with the path, where the file is missing, is no model of this shape, or has no calibration.
    Raises it, too, without onnxruntime, and if no path is given and the package has no model.
    """

    def __init__(self, path: Path | None = None, threads: int = 1) -> None:
        self.path = path or shipped_model()
        if path is None and not self.path.is_file():
            raise ValueError(f"no model is in the package; `pilsim train-detector --out DIR` makes one, and --model DIR/{self.path.name} takes it")
        data = _read(self.path)
        self.checksum = hashlib.sha256(data).hexdigest()
        try:
            self._session = _session(data, threads)
            self._check()
        except ValueError as error:
            raise ValueError(f"{self.path}: {error}") from None

    def __call__(self, image: NDArray[np.float32]) -> Maps:
        """The outputs for an image (1, 3, H, W), RGB in 0 to 1, H and W multiples of 32."""
        return {name: values[0] for name, values in zip(self._outputs, self._session.run(self._outputs, {"image": image}), strict=True)}

    def _check(self) -> None:
        """Compare names and shapes with the interface, by a run on the smallest image, and read the calibration."""
        inputs, outputs = [one.name for one in self._session.get_inputs()], [one.name for one in self._session.get_outputs()]
        if inputs != ["image"] or not {"scores", "edges"} <= set(outputs):
            raise ValueError(f"has inputs {_few(inputs)} and outputs {_few(outputs)}, needs image, and scores and edges: no person detector")
        self._outputs = [name for name in CHANNELS if name in outputs]
        text = self._session.get_modelmeta().custom_metadata_map.get(KEY)
        if text is None:
            raise ValueError(f"has no metadata {KEY!r} with the calibration of its scores")
        try:
            self.calibration = ScoreCalibration.parse(text)
        except ValueError as error:
            raise ValueError(f"metadata {KEY!r}: {error}") from None
        for shape in ((MULTIPLE, MULTIPLE), (MULTIPLE, 2 * MULTIPLE)):
            try:
                maps = self(np.zeros((1, 3, *shape), dtype=np.float32))
            except Exception as error:
                # onnxruntime has error classes of its own, all of them children of Exception alone.
                raise ValueError(f"does not run on an image of 3 x {shape[0]} x {shape[1]} ({_line(error)})") from None
            for name, values in maps.items():
                wanted = (CHANNELS[name], shape[0] // STRIDE, shape[1] // STRIDE)
                if values.shape != wanted or values.dtype != np.float32:
                    raise ValueError(f"output {name} is {values.dtype} {values.shape}, needs float32 {wanted}")


def _read(path: Path) -> bytes:
    if not path.is_file():
        raise ValueError(f"{path}: no such model file")
    if path.stat().st_size > LARGEST_MODEL:
        raise ValueError(f"{path}: has {path.stat().st_size} bytes, needs at most {LARGEST_MODEL}")
    return path.read_bytes()


def _session(data: bytes, threads: int) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise ValueError("needs onnxruntime to run, which is missing; `pip install onnxruntime` installs it") from None
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.use_deterministic_compute = True
    options.log_severity_level = 4
    try:
        return onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])
    except Exception as error:
        raise ValueError(f"is no ONNX model that onnxruntime can load ({_line(error)})") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:120]


def _few(names: list[str]) -> str:
    return ", ".join(name[:40] for name in names[:6]) or "none"
