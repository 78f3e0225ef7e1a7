"""Inputs and surroundings that users of comparable software reported as faults, each with its tests, and those of odd data by command.

CASES names the tests of each. Tests in surroundings that need root, a mount or a signal stand in the files that CASES names.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

from sim.cli.main import _parse
from tests.commands import pilsim
from tests.sim.cli.test_surroundings import BOXES, CAMERA
from tests.tracker.planar_slam.mrclam import write_set
from tracker.planar_slam.utias_run import track_utias

ROOT = Path(__file__).parent
HERE = "test_cases.py"
CASES: dict[str, tuple[str, ...]] = {
    "no place for numba's cache": (
        "tracker/geometry/test_compilation.py::test_without_any_folder_for_it_the_temporary_folder_has_the_cache",
        "tracker/geometry/test_compilation.py::test_a_truncated_cache_is_made_anew",
        "tracker/geometry/test_compilation.py::test_a_folder_of_another_user_is_no_cache",
        "sim/cli/test_wheel.py::test_all_works_where_little_may_be_written",
    ),
    "output is a mount point": (
        "sim/cli/test_output_folders.py::test_a_mount_point_in_a_folder_that_cannot_be_written",
        "sim/cli/test_output_folders.py::test_results_are_kept_where_the_disk_is_full",
    ),
    "started twice": (
        "sim/cli/test_output_folders.py::test_a_second_writer_is_refused_before_the_work",
        "tracker/io/test_file_lock.py::test_a_second_process_is_refused_until_the_first_is_killed",
    ),
    "two OBJ exports in one folder": ("worlds/test_export.py::test_two_obj_exports_in_one_folder_share_no_file",),
    "MUJOCO_GL that cannot be loaded": (
        "sim/cli/test_graphics_choice.py::test_commands_without_the_library",
        "sim/cli/test_graphics_choice.py::test_the_benchmark_says_so_in_one_line",
        "sim/cli/test_graphics_choice.py::test_a_backend_of_another_system_is_named",
    ),
    "no standard output or error": (
        "sim/cli/test_streams.py::test_closed_streams",
        "sim/cli/test_streams.py::test_files_are_written_under_names_that_a_locale_lacks_though_standard_error_is_full",
    ),
    "terminal that is not UTF-8": ("sim/cli/test_streams.py::test_characters_that_a_stream_lacks_are_replaced",),
    "one late row": ("tracker/planar_slam/test_event_schedule.py::test_a_late_row_takes_no_memory_and_its_gap_is_said",),
    "time steps back a little": (
        f"{HERE}::test_rows_a_little_out_of_order_are_sorted",
        "tracker/planar_slam/test_utias_files.py::test_rows_that_step_back_a_little_are_sorted_and_repeated_rows_merged",
    ),
    "byte order mark": (
        "sim/cli/test_surroundings.py::test_byte_order_marks",
        "fuzz/test_readers.py::test_marks_line_ends_and_blanks_do_not_matter",
    ),
    "detections given as results": ("sim/cli/test_surroundings.py::test_detections_are_no_tracks",),
    "a number that is none": (
        "tracker/planar_slam/test_trajectories.py::test_bad_rows_are_named",
        "fuzz/test_readers.py::test_a_word_for_a_number_is_named_by_its_line",
    ),
    "all confidences -1": (f"{HERE}::test_few_people_are_explained",),
    "warnings of libraries leak": (f"{HERE}::test_no_warning_of_a_library",),
    "clique --json prints Infinity": (
        "sim/cli/test_surroundings.py::test_an_infinite_weight_is_refused",
        "sim/cli/test_printed_json.py::test_clique_of_a_graph_without_edges",
    ),
    "Ctrl-C during imports": ("sim/cli/test_interrupts.py::test_during_imports",),
    "no Windows (fcntl)": ("sim/cli/test_platforms.py::test_every_module_is_imported_without_what_a_system_lacks",),
    "intervals leave the range of their figure": ("sim/report/test_report.py::test_no_interval_leaves_the_range_of_its_figure",),
    "damaged files": ("fuzz/test_readers.py::test_damaged_files_are_read_or_refused",),
    "numbers that decide on memory": ("fuzz/test_memory.py::test_large_numbers_take_little_memory",),
}
"""Case → its tests, in the order of the reports."""


@pytest.mark.parametrize("case", CASES)
def test_every_case_has_its_tests(case: str) -> None:
    for name in CASES[case]:
        file, _, function = name.partition("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}, name


def strict(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a command to which all warnings are errors."""
    command = [sys.executable, "-W", "error", "-m", "pilsim", *map(str, words)]
    return subprocess.run(command, cwd=ROOT.parent, capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.command
def test_rows_a_little_out_of_order_are_sorted(tmp_path: Path) -> None:
    """Two rows are exchanged, which are 0.1 s apart, and one stands twice. The results are those of the set in order."""
    clean, mixed = write_set(tmp_path / "clean", 10.0), write_set(tmp_path / "mixed", 10.0)
    path = mixed / "Robot1_Odometry.dat"
    lines = path.read_text().splitlines()
    lines[50], lines[51] = lines[51], lines[50]
    path.write_text("\n".join([*lines, lines[-1], ""]))
    track_utias(clean, tmp_path / "clean-out", False)
    done = pilsim("track", mixed, "--out", tmp_path / "mixed-out")
    assert done.returncode == 0, done.stderr
    note = "Robot1_Odometry.dat: 1 row out of order by up to 0.10 s sorted, 1 repeated row merged"
    assert done.stdout.splitlines()[0] == note
    assert json.loads((tmp_path / "mixed-out" / "run.json").read_text())["mended"] == [note]
    assert (tmp_path / "clean-out" / "robots.csv").read_bytes() == (tmp_path / "mixed-out" / "robots.csv").read_bytes()


def pets(folder: Path, boxes: str) -> Path:
    """A PETS folder of one view with these detections."""
    for name in ("calibration", "detections"):
        (folder / name).mkdir(parents=True)
    (folder / "calibration" / "View_001.xml").write_text(CAMERA)
    (folder / "detections" / "View_001.txt").write_text(boxes)
    return folder


@pytest.mark.parametrize(
    ("boxes", "why"),
    [
        (BOXES.replace(",0.95,", ",-1,"), ""),
        (BOXES.replace(",20,60,", ",20,30,"), "no people: of 8 boxes 8 are lower than 1.4 m"),
        (BOXES.replace("340,120,", "340,-500,"), "no people: of 8 boxes 8 have no ground point"),
        (BOXES.splitlines()[0] + "\n", "no people: of 1 boxes 1 may begin a track, but are in too few frames"),
        (BOXES, ""),
    ],
)
def test_few_people_are_explained(tmp_path: Path, boxes: str, why: str, capsys: pytest.CaptureFixture[str]) -> None:
    command = _parse(["track", str(pets(tmp_path / "pets", boxes)), "--out", str(tmp_path / "out")])
    assert command is not None
    command.run()
    first, *more = capsys.readouterr().out.splitlines()
    assert f"{int(not why)} people in " in first
    assert [line.startswith(why) for line in more] == [True] * bool(why)


@pytest.mark.command
def test_no_warning_of_a_library(tmp_path: Path) -> None:
    """A robot that measured nothing."""
    source = write_set(tmp_path / "set", 10.0)
    (source / "Robot1_Measurement.dat").write_text("")
    done = strict("track", source, "--out", tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
    done = strict("score", source, tmp_path / "out")
    assert (done.returncode, done.stderr) == (0, "")
