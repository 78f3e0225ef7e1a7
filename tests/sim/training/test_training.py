"""The network, its loss, and the whole training in small."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

from sim.cli.train_detector import TrainDetector
from sim.training.scene_rendering import PINHOLES, ROOMS
from sim.training.training import DATA, FIGURES, MODEL, ORDER, TrainingPlan, check_needed, train_detector
from worlds.scenes import meeting_room

torch = pytest.importorskip("torch", reason="needs torch (make rl)")
pytest.importorskip("onnx", reason="needs onnx (make rl)")
onnxruntime = pytest.importorskip("onnxruntime", reason="needs onnxruntime (make rl)")


def test_overlap_of_equal_and_of_shifted_boxes():
    from sim.training.optimization import generalized_iou

    one = torch.tensor([2.0, 2.0, 2.0, 2.0]).view(1, 4, 1, 1)
    wide = torch.tensor([2.0, 2.0, 6.0, 2.0]).view(1, 4, 1, 1)
    assert float(generalized_iou(one, one)) == pytest.approx(1.0)
    # The smaller box lies in the larger one, which is the hull: IoU 16 / 32 alone.
    assert float(generalized_iou(one, wide)) == pytest.approx(0.5)


def test_the_right_answer_has_a_smaller_loss():
    from sim.training.optimization import detection_loss
    from sim.training.targets import targets_of

    made = targets_of(np.array([[40.0, 30.0, 72.0, 130.0]]), np.ones(1), 256, np.array([[40.0, 30.0, 72.0, 90.0]]))
    targets = {name: torch.from_numpy(getattr(made, name))[None] for name in ("heat", "counted", "edges", "weight", "worth", "hidden")}
    right = (
        torch.where(targets["heat"] == 1, 6.0, -6.0),
        targets["edges"].log(),
        torch.full((1, 4, 64, 64), -2.0),
        torch.logit(targets["hidden"], 1e-4),
    )
    wrong = -right[0], right[1] + 0.5, right[2], right[3] + 1.0
    for name, value in detection_loss(right, targets).items():
        assert float(value) < float(detection_loss(wrong, targets)[name]), name


def test_bad_plans_are_refused(tmp_path):
    with pytest.raises(ValueError, match="steps is 0, needs 1 to"):
        TrainingPlan(steps=0)
    (tmp_path / "other.txt").write_text("mine")
    with pytest.raises(ValueError, match=r"other\.txt"):
        train_detector(TrainingPlan(), tmp_path)
    check_needed()


def test_the_command_has_the_defaults_of_a_plan():
    command = TrainDetector(Path("D"))
    assert TrainingPlan(**{field.name: getattr(command, field.name) for field in dataclasses.fields(TrainingPlan)}) == TrainingPlan()


def test_a_network_takes_the_weights_of_a_model():
    from sim.training.network import PersonNetwork
    from sim.training.onnx_model import take_weights
    from tracker.person_detector.network import PersonNetwork as Model

    pictures = np.random.default_rng(0).integers(0, 256, (3, 96, 96, 3), np.uint8)
    model, network = Model(), PersonNetwork()
    take_weights(network, model.path, [pictures, pictures[::-1].copy()])
    image = pictures[:1].transpose(0, 3, 1, 2).astype(np.float32) / np.float32(255)
    with torch.no_grad():
        # With the statistics that were taken, and with those of the batch, as in training.
        alone, among = (
            network.eval()(torch.from_numpy(image)),
            network.train()(torch.from_numpy(pictures.transpose(0, 3, 1, 2).astype(np.float32) / 255)),
        )
    said = model(image)
    for k, name in enumerate(("scores", "edges")):
        for outputs in (alone, among):
            assert np.corrcoef(outputs[k][0].numpy().ravel(), said[name].ravel())[0, 1] > 0.97


@pytest.mark.soak
def test_whole_training_in_small(tmp_path):
    """Data, training, export, calibration and scores; an interrupted training continues to the same model; another plan is refused."""
    plan = TrainingPlan(scenes=1, moments=1, steps=2, calibration=1, held_out=1)
    figures = train_detector(plan, tmp_path)
    assert json.loads((tmp_path / FIGURES).read_text()) == figures
    model = (tmp_path / MODEL).read_bytes()
    session = onnxruntime.InferenceSession(model)
    entry = json.loads(session.get_modelmeta().custom_metadata_map["pilsim"])
    assert entry["version"] == 1
    assert (np.diff(np.array(entry["calibration"]), axis=0) >= 0).all()
    shapes = [output.shape for output in session.run(None, {"image": np.zeros((1, 3, 64, 96), np.float32)})]
    assert shapes == [(1, 1, 16, 24), (1, 4, 16, 24), (1, 4, 16, 24), (1, 4, 16, 24)]
    for name in (FIGURES, MODEL, "checkpoint.pt"):
        (tmp_path / name).unlink()
    assert train_detector(plan, tmp_path) == figures
    assert (tmp_path / MODEL).read_bytes() == model
    with pytest.raises(ValueError, match="another training"):
        train_detector(dataclasses.replace(plan, steps=3), tmp_path)
    # A training from a model, with the same scenes.
    again = dataclasses.replace(plan, start=(tmp_path / MODEL).rename(tmp_path.with_suffix(".onnx")), workers=1)
    for name in (FIGURES, "checkpoint.pt"):
        (tmp_path / name).unlink()
    (tmp_path / ORDER).write_text(json.dumps(again.order))
    assert "ap50" in train_detector(again, tmp_path)["room panorama"]


def test_scenes_of_earlier_trainings_are_added(tmp_path: Path) -> None:
    """Each training is stated with those before it; one whose scenes are not all there is refused, as is going on without it."""
    first, out = tmp_path / "first", tmp_path / "out"
    plan = TrainingPlan(scenes=2, earlier=(first,))
    (first / DATA / "scene-0000").mkdir(parents=True)
    (first / ORDER).write_text(json.dumps(TrainingPlan(scenes=1).order))
    assert plan.order["earlier"] == [TrainingPlan(scenes=1).order]
    with pytest.raises(ValueError, match="has 0 of its 1 scenes, needs all"):
        train_detector(plan, out)
    (first / DATA / "scene-0000" / f"{PINHOLES}.npz").touch()
    (out / DATA / "scene-0000").mkdir(parents=True)
    (out / DATA / "scene-0000" / f"{PINHOLES}.npz").touch()
    assert plan.scenes_of(out) == [folder / DATA / "scene-0000" for folder in (first, out)]
    (out / ORDER).write_text(json.dumps(plan.order))
    with pytest.raises(ValueError, match="another training"):
        train_detector(dataclasses.replace(plan, earlier=()), out)


def test_scenes_are_rich_unless_told_otherwise(tmp_path: Path) -> None:
    plain, rich = TrainingPlan(rich=False), TrainingPlan()
    assert "rich" not in plain.order
    assert rich.order == plain.order | {"rich": True, "rooms": ROOMS, "judged_rooms": 30}
    tasks, others = plain.tasks(tmp_path), rich.tasks(tmp_path)
    assert not any(task.rich for some in tasks.values() for task in some)
    assert all(task.rich for task in others["data"] + others["calibration"])
    assert tasks["held-out"] == others["held-out"]
    assert not tasks["rooms"]
    assert {task.world for task in others["rooms"]} == {meeting_room.NAME}
    assert not {task.seed for task in others["rooms"]} & {task.seed for task in others["data"] + others["calibration"]}
