"""The command `pilsim train-detector`: train the person detector on rendered images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from sim.cli.options import Out, json_text, unset


@dataclass(frozen=True)
class TrainDetector:
    """Train the detector of people on rendered images alone.

    Renders scenes, trains the network, exports it as ONNX, calibrates its scores
    and scores it on held-out worlds. The same command continues a training that
    was interrupted. It needs the extra `train` (torch, onnx, onnxruntime).

    Examples: pilsim train-detector --out runs/detector
              pilsim train-detector --scenes 200 --steps 40000 --seed 1 --out D
              pilsim train-detector --start OLD.onnx --scenes 128 --steps 10000 --out D
    """

    out: Out
    """Folder of the training: data, checkpoint, person_detector.onnx, figures.json, curves.png, frames.png."""
    seed: int = 0
    """Seed of the scenes and of the training."""
    scenes: int = 96
    """Number of rendered scenes, each with its own crowd, world and light."""
    moments: int = 10
    """Number of moments of a scene; each gives a panorama and three images of pinhole cameras."""
    steps: int = 12_000
    """Number of steps of the optimizer; about four a second on one core with bfloat16."""
    calibration: int = 18
    """Number of scenes on which the scores are calibrated."""
    held_out: int = 35
    """Number of scenes on which the detector is scored: seeds 2000 and on, seven worlds each; and as many rooms, at most 30."""
    workers: int = 2
    """Number of processes; the result is the same with any number."""
    rich: bool = True
    """Scenes have people in groups, people who sit, varied clothing and wet ground, too, and there are rooms with tables."""
    start: Annotated[Path | None, unset("MODEL.onnx", "random weights")] = None
    """Model of an earlier training that gives the initial weights; the learning rate is lower then."""
    earlier: Annotated[tuple[Path, ...], unset("DIR [DIR ...]", "none")] = ()
    """Folders of earlier trainings; the scenes that they rendered are added to the new ones."""
    json: bool = False
    """Print JSON alone."""

    def run(self) -> None:
        from sim.training.training import MODEL, TrainingPlan, train_detector

        plan = TrainingPlan(
            self.seed, self.scenes, self.moments, self.steps, self.calibration, self.held_out, self.workers, self.rich, self.start, self.earlier
        )
        result = train_detector(plan, self.out)
        if self.json:
            print(json_text(result, indent=1))
            return
        for kind in (name for name in result if name.endswith(("panorama", "pinhole"))):
            for name, value in result[kind].items():
                print(f"{kind:14} {name:30} {value}")
        print(f"{self.out / MODEL}: {result['parameters']} parameters; curves.png and frames.png show it")
