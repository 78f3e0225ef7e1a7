"""The sentences of a report, on rows whose scores are a formula."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sim.report.findings import (
    CAUSES,
    at,
    breaking,
    change,
    finding,
    findings,
    headline,
    listed,
    moments,
    owner,
    predicted,
    reasons,
    robots,
    spread,
    summary,
)
from sim.report.rows import Rows, read_rows
from sim.stress.error_causes import CAUSES as COUNTED
from tests.sim import stress_rows


def read(folder: Path, rows: list[dict[str, Any]]) -> Rows:
    return read_rows(stress_rows.write(folder, rows))


def test_a_fall_its_setting_and_its_causes(tmp_path: Path) -> None:
    rows = read(tmp_path, stress_rows.density() + stress_rows.terrain())
    first, second = findings(rows, "default")
    # MOTA is 1 − people / 125 on average over the five seeds, so 0.96 at 5 and 0.2 at 100.
    assert (first.sweep.name, second.sweep.name) == ("density", "terrain")
    assert change(first).startswith("MOTA falls from 0.96 (")
    assert "at 5 people to 0.20 (" in change(first)
    assert breaking(first) == "It is below 0.5 at 100 people."
    worst = first.worst.of("default")
    why = (
        "70 % misses, 20 % false positives and 10 % switches. The most frequent cause is occluded (misses), 42 % of all errors: less than a fifth of"
    )
    assert why in reasons(worst, "x")
    assert owner(worst, "x").startswith(
        "The loss of MOTA at x is 0.80. Perfect input to poses, detections, association and terrain together would recover 0.80 ("
    )
    assert "The largest shares are detections with 0.48 (" in owner(worst, "x")
    assert "not significant" not in owner(worst, "x")
    assert robots(first).startswith("The ATE of the robots is 0.035 (")
    assert "m at 100 people; it is 0.200 m by dead reckoning alone; no filter can be better than 0.020 m (the Cramér-Rao bound)." in robots(first)
    assert second.fall == 0
    assert change(second).startswith("No significant difference is seen")
    assert breaking(second) == "It stays above 0.5 at every setting."


def test_the_headline_is_the_largest_significant_fall(tmp_path: Path) -> None:
    rows = read(tmp_path, stress_rows.terrain() + stress_rows.density())
    assert headline(rows) == (
        "Density has the largest effect: MOTA (1 is perfect) falls from 0.96 at 5 people to 0.20 at 100 people."
        " The most frequent errors there: misses (occluded)."
    )
    assert "no setting is significantly worse than another" in headline(read(tmp_path / "t", stress_rows.terrain()))


def test_one_seed_and_few_seeds_are_uncertain(tmp_path: Path) -> None:
    one = read(tmp_path / "one", stress_rows.density(1))
    found = finding(one.sweeps()[0], "default")
    assert found is not None
    assert "One seed alone cannot show" in change(found)
    assert found.fall == 0
    assert "there are no intervals" in dict(summary(one))["Certainty"]
    assert "fewer than 5" in dict(summary(read(tmp_path / "two", stress_rows.density(2))))["Certainty"]
    assert "fewer" not in dict(summary(read(tmp_path / "five", stress_rows.density(5))))["Certainty"]


@pytest.mark.soak
def test_noise_alone_is_no_fall(tmp_path: Path) -> None:
    """Settings that differ by chance only are rarely called different, although the best and the worst of six are compared."""
    rng, called = np.random.default_rng(0), 0
    for trial in range(60):
        rows = [stress_rows.row("terrain", k, f"v{k}", seed) for k in range(6) for seed in range(5)]
        for row in rows:
            row["scores"]["mota"] = float(rng.normal(0.8, 0.05))
        found = finding(read(tmp_path / str(trial), rows).sweeps()[0], "default")
        assert found is not None
        called += found.fall > 0
    assert called <= 7


def test_failures_are_reported(tmp_path: Path) -> None:
    rows = stress_rows.density(2)
    rows[0] = stress_rows.failed(rows[0], "RuntimeError: boom")
    text = dict(summary(read(tmp_path / "some", rows)))["Certainty"]
    assert "1 run of 8 failed and is left out of all means (1 × RuntimeError: boom)" in text
    every = read(tmp_path / "all", [stress_rows.failed(row, "RuntimeError: boom") for row in rows])
    assert dict(summary(every))["Results"] == "Every run failed or has no score: 8 × RuntimeError: boom."
    assert headline(every).startswith("No run has a score")


def test_several_trackers_and_versions_are_reported(tmp_path: Path) -> None:
    mine = [row | {"tracker": {"name": "mine", "options": {}}, "versions": {"pilsim": "9"}} for row in stress_rows.density(2)]
    text = dict(summary(read(tmp_path, stress_rows.density(2) + mine)))
    assert "default 0.65 over 8 runs and mine 0.65 over 8 runs" in text["Trackers"]
    assert "different versions" in text["Certainty"]


@pytest.mark.parametrize(
    ("mota", "sentence"),
    [
        ((0.9, 0.4, 0.3, 0.2), "It is below 0.5 from 20 people up."),
        ((0.1, 0.4, 0.6, 0.9), "It is below 0.5 from 20 people down."),
        ((0.9, 0.4, 0.9, 0.2), "It is below 0.5 at 20 people and 100 people."),
        ((0.1, 0.4, 0.3, 0.2), "It is below 0.5 at every setting, so the tracker is broken before the sweep begins."),
    ],
)
def test_where_it_breaks(mota: tuple[float, ...], sentence: str, tmp_path: Path) -> None:
    rows = stress_rows.density(2)
    for row in rows:
        row["scores"]["mota"] = mota[int(row["id"][-1])]
    found = finding(read(tmp_path, rows).sweeps()[0], "default")
    assert found is not None
    assert breaking(found) == sentence


def test_two_stages_with_equal_shares_are_not_ranked(tmp_path: Path) -> None:
    rows = [stress_rows.row("density", 0, 5, seed) for seed in range(4)]
    for row in rows:
        more = 0.01 * (-1) ** row["seed"]
        row["ladder"] = {"mota": {"poses": 0.1 + more, "detections": 0.1 - more, "association": 0.0, "terrain": 0.0, "total": 0.2}}
    found = finding(read(tmp_path, rows).sweeps()[0], "default")
    assert found is not None
    assert owner(found.best.of("default"), "here").endswith("the difference between these two is not significant.")


def test_real_beside_its_twin(tmp_path: Path) -> None:
    rows = [stress_rows.row("pets", k, value, 0) for k, value in enumerate(("real", "twin"))]
    rows = [row | {"id": f"pets/{row['value']}", "parameter": "source"} for row in rows]
    rows[0]["scores"] |= {"mota": 0.98, "idf1": 0.97}
    rows[1]["scores"] |= {"mota": 0.95, "idf1": 0.99}
    folder = read(tmp_path, rows + stress_rows.density(2))
    sentence = predicted(folder.sweeps()[0], "default")
    assert sentence.startswith("MOTA is 0.980 on the real sequence and 0.950 on its simulated twin (−0.030); IDF1 is 0.970")
    assert [f.sweep.name for f in findings(folder, "default")] == ["density"]
    # The real row has the number of frames of the other runs, which does not hold for it.
    assert "2 seeds, 60 frames each, the real sequence and its twin at their own length;" in dict(summary(folder))["What was tested"]
    assert "frames" not in dict(summary(read(tmp_path / "alone", rows)))["What was tested"]
    assert "60 frames each;" in dict(summary(read(tmp_path / "ours", stress_rows.density(2))))["What was tested"]


def test_a_real_sequence_alone_has_findings(tmp_path: Path) -> None:
    rows = [stress_rows.row("pets", k, value, 0, id=f"pets/{value}", parameter="source") for k, value in enumerate(("real", "twin"))]
    both = read(tmp_path / "both", rows)
    assert headline(both).startswith("MOTA is 0.900 on the real sequence and 0.910 on its simulated twin")
    assert dict(summary(both))["Results"] == headline(both)
    assert dict(summary(both))["What was tested"] == (
        "Tracking of people; tracker: default. A real sequence, PETS 2009 S2.L1, compared with its simulated twin. 2 runs of 2 settings and 1 seed."
    )
    one = read(tmp_path / "one", [rows[0], stress_rows.failed(rows[1], "boom")])
    assert headline(one) == "MOTA is 0.90 at source = real, the only setting with a score."
    assert "1 run of 2 failed" in dict(summary(one))["Certainty"]


def test_a_recording_is_no_simulation_and_a_room_has_no_robots(tmp_path: Path) -> None:
    rows = [stress_rows.row("recorded_misses", k, value, 0, parameter="drop") for k, value in enumerate((0.0, 0.5))]
    text = dict(summary(read(tmp_path / "recorded", rows)))
    assert text["What was tested"].startswith("Tracking of people by the cameras of a recording with known truth; tracker: default.")
    assert text["What was tested"].endswith("1 seed, at most 60 frames each.")
    assert "cameras see 98 %" in text["Distance from the limits"]
    room = stress_rows.row("room", 0, 3, 0, parameter="people")
    room["scenario"]["robots"] = 0
    assert "cameras see 98 %" in dict(summary(read(tmp_path / "room", [room])))["Distance from the limits"]
    assert "robots see 98 %" in dict(summary(read(tmp_path / "rovers", [stress_rows.row("robots", 0, 7, 0)])))["Distance from the limits"]


def test_a_map_without_landmarks_that_were_seen_often(tmp_path: Path) -> None:
    row = stress_rows.row("density", 0, 5, 0)
    row["scores"]["map_complete"] = None
    text = dict(summary(read(tmp_path, [row])))["Distance from the limits"]
    assert "The error of landmarks is 0.04 m. Ghosts are 10 % of the map." in text


def test_the_worst_moments_are_of_many_kinds(tmp_path: Path) -> None:
    rows = stress_rows.density(5)
    for n, row in enumerate(rows):
        row["moments"] = [{"kind": "miss", "cause": "occluded", "weight": 10 + n}, {"kind": "switch", "cause": f"c{n}", "weight": n}]
    chosen = moments(read(tmp_path, rows))
    assert len(chosen) == 10
    assert [m["weight"] for _, m in chosen] == sorted((m["weight"] for _, m in chosen), reverse=True)
    assert sum(m["kind"] == "miss" for _, m in chosen) == 3


def test_settings_and_lists_in_words(tmp_path: Path) -> None:
    assert [listed(names) for names in (["a"], ["a", "b"], ["a", "b", "c"])] == ["a", "a and b", "a, b and c"]
    density, terrain = read(tmp_path, stress_rows.density(1) + stress_rows.terrain(1)).sweeps()
    assert (spread(density), spread(terrain)) == ("people from 5 to 100", "terrain exact, coarse or flat")
    assert [at(s) for s in (density.settings[0], terrain.settings[2])] == ["5 people", "knowledge of terrain: flat"]
    other = read(tmp_path / "other", [stress_rows.row("mine", 0, 0.5, 0)]).sweeps()[0]
    assert at(other.settings[0]) == "mine = 0.5"


def test_every_cause_has_a_meaning() -> None:
    assert {cause for causes in COUNTED.values() for cause in causes} == set(CAUSES)
