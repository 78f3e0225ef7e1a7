"""Runs of the planar filter: the circle among 24 landmarks beside the Cramér-Rao bound, synthetic UTIAS sets, and errors."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.slam import Row, drive, estimate, rows
from tests.tracker.planar_slam.mrclam import BEGIN, SECONDS, write_set
from tracker.planar_slam.event_schedule import PlanarParameters, filter_input, run_filter
from tracker.planar_slam.filter import SCAN, STEP
from tracker.planar_slam.motion_model import Sensors, integrate
from tracker.planar_slam.utias_files import read_utias

EKF = PlanarParameters("ekf", 1, correction=False, robust=np.inf, curvature=0.0)


@pytest.fixture(scope="module")
def second_level() -> dict[str, Row]:
    default = PlanarParameters()
    return rows("3°, 0.2 m", False, {"ekf": EKF, "default": default, "off": replace(default, correction=False)}, 30)


@pytest.mark.soak
def test_the_default_is_consistent_and_near_the_bound(second_level: dict[str, Row]) -> None:
    assert 0.75 < second_level["default"].nees.mean() < 1.25
    assert second_level["default"].efficiency < 1.2


@pytest.mark.soak
def test_the_plain_filter_is_overconfident(second_level: dict[str, Row]) -> None:
    assert second_level["ekf"].nees.mean() > 2
    assert second_level["ekf"].rmse > 1.1 * second_level["default"].rmse


@pytest.mark.soak
def test_the_correction_factor_costs_what_the_bound_says(second_level: dict[str, Row]) -> None:
    on, off = second_level["default"], second_level["off"]
    assert (on.bound >= off.bound * (1 - 1e-9)).all()
    assert on.rmse / off.rmse < np.sqrt(on.bound.mean() / off.bound.mean()) + 0.03


def test_true_offsets_are_estimated() -> None:
    level = "1°, 0.1 m"
    iterated = PlanarParameters("iekf", 2, robust=np.inf, curvature=0.0)
    table = rows(level, True, {"on": PlanarParameters(), "off": PlanarParameters(correction=False), "iekf on": iterated,
                               "iekf off": replace(iterated, correction=False)}, 20)  # fmt: skip
    assert table["on"].rmse < 0.85 * table["off"].rmse
    assert table["iekf on"].rmse < 0.6 * table["iekf off"].rmse
    assert table["off"].nees.mean() > 2 > table["on"].nees.mean()


def test_a_diverging_filter_names_time_and_robot() -> None:
    run = drive("1°, 0.1 m", False, 0)
    run.measured.z[700:, 0] = 1e200
    with pytest.raises(ValueError, match=r"the filter diverged at \d+\.\d+ s: robot 0 is at "):
        estimate(run, EKF, False)


@pytest.fixture(scope="module")
def ideal_sensors() -> Sensors:
    """The sensors that the synthetic set was made with."""
    return Sensors(speed_delay=0, turn_delay=0, lag=1e-3, speed_scale=1, turn_scale=1, turn_loss=0, camera_delay=0, robot_range=0)


def test_events_are_in_order_and_robots_are_predicted_to_their_scans(tmp_path_factory: pytest.TempPathFactory, ideal_sensors: Sensors) -> None:
    team = read_utias(write_set(tmp_path_factory.mktemp("a") / "s"))
    out = filter_input(team, ideal_sensors, False, True)
    schedule = out.schedule
    assert (np.diff(schedule.time) >= 0).all()
    assert out.times[0] == BEGIN
    here = [BEGIN, BEGIN]
    for kind, robot, item, time in zip(schedule.kind, schedule.robot, schedule.item, schedule.time, strict=True):
        if kind == STEP:
            here[robot] = time
        elif kind == SCAN:
            involved = {int(robot), *(s for s in schedule.subject[schedule.start[item] : schedule.start[item + 1]].tolist() if s < 2)}
            assert all(here[i] == time for i in involved)


@pytest.mark.parametrize("known", [True, False])
def test_a_synthetic_set_is_tracked(tmp_path_factory: pytest.TempPathFactory, ideal_sensors: Sensors, known: bool) -> None:
    team = read_utias(write_set(tmp_path_factory.mktemp("b") / "s"))
    out = filter_input(team, ideal_sensors, known, True)
    path, _ = run_filter(out.state, PlanarParameters().settings(), out.schedule)
    for i, robot in enumerate(team.robots.values()):
        x, y = (np.interp(out.times, robot.truth[:, 0], robot.truth[:, k]) for k in (1, 2))
        assert np.hypot(path[:, i, 0] - x, path[:, i, 1] - y).max() < 0.03
    assert out.times[-1] - BEGIN == pytest.approx(SECONDS, abs=0.1)
    assert out.state.initialized.all()


def test_odometry_that_ends_before_the_starts_is_an_error(tmp_path_factory: pytest.TempPathFactory, ideal_sensors: Sensors) -> None:
    folder = write_set(tmp_path_factory.mktemp("c") / "s")
    lines = (folder / "Robot1_Odometry.dat").read_text().splitlines()
    (folder / "Robot1_Odometry.dat").write_text(lines[0] + "\n")
    with pytest.raises(ValueError, match=r"odometry ends at 1000.000 s, needs to go on after 1000.000 s"):
        filter_input(read_utias(folder), ideal_sensors, False, True)


def test_a_gap_of_the_odometry_is_counted_and_bridged(tmp_path_factory: pytest.TempPathFactory, ideal_sensors: Sensors) -> None:
    """Robot 1 has no odometry for half of the time; its measurements correct it afterwards."""
    folder = write_set(tmp_path_factory.mktemp("d") / "s")
    path = folder / "Robot1_Odometry.dat"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(x for x in lines if x.startswith("#") or not BEGIN + 2 < float(x.split()[0]) < BEGIN + 2 + SECONDS / 2) + "\n")
    out = filter_input(read_utias(folder), ideal_sensors, True, True)
    assert out.unused["odometry gap"] == 1
    estimated, _ = run_filter(out.state, PlanarParameters().settings(), out.schedule)
    truth = read_utias(folder).robots[1].truth
    x, y = (np.interp(out.times[-1], truth[:, 0], truth[:, k]) for k in (1, 2))
    assert np.hypot(estimated[-1, 0, 0] - x, estimated[-1, 0, 1] - y) < 0.1


def test_a_late_row_takes_no_memory_and_its_gap_is_said(tmp_path_factory: pytest.TempPathFactory, ideal_sensors: Sensors) -> None:
    """The last command of both robots is two years late; all poses before are those of the set without it."""
    folder = write_set(tmp_path_factory.mktemp("e") / "s")
    clean = filter_input(read_utias(folder), ideal_sensors, True, True)
    for n in (1, 2):
        with (folder / f"Robot{n}_Odometry.dat").open("a") as file:
            file.write(f"{BEGIN + 6e7} 0 0\n")
    tracemalloc.start()
    out = filter_input(read_utias(folder), ideal_sensors, True, True)
    assert tracemalloc.get_traced_memory()[1] < 1 << 27
    tracemalloc.stop()
    assert out.left_out == ("no robot has odometry from 1059.980 to 60001000.000 s: this gap of 59999940 s is left out",)
    np.testing.assert_array_equal(out.times, clean.times)
    paths = [run_filter(s.state, PlanarParameters().settings(), s.schedule)[0] for s in (clean, out)]
    np.testing.assert_array_equal(*paths)


def test_motion_goes_on_after_a_long_gap(ideal_sensors: Sensors) -> None:
    """Two stretches of 10 s at 1 m/s, 1000 s apart, cover 10 m each and the time until the command times out."""
    t = np.arange(0, 10, 0.1)
    odometry = np.array([[time, 1.0, 0.0] for time in (*t, *(1000 + t))])
    moved = integrate(odometry, ideal_sensors, np.array([5.0, 100.0, 999.0, 1005.0, 1100.0]))
    np.testing.assert_allclose(moved[:, 0], [5, 11.9, 11.9, 16.9, 23.8], atol=0.03)


def test_only_gaps_or_too_much_odometry_is_an_error(tmp_path_factory: pytest.TempPathFactory, ideal_sensors: Sensors) -> None:
    folder = write_set(tmp_path_factory.mktemp("f") / "s")
    for scale, message in ((1e4, "odometry has only gaps of more than 60 s, needs times in seconds"), (2000.0, r"odometry covers 1199\d\d s")):
        for n in (1, 2):
            t = BEGIN + scale * np.arange(0, 60, 0.02)
            np.savetxt(folder / f"Robot{n}_Odometry.dat", np.stack([t, 0 * t, 0 * t], axis=1), "%.6f")
        with pytest.raises(ValueError, match=message):
            filter_input(read_utias(folder), ideal_sensors, False, True)
