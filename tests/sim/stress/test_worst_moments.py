"""The worst moments: grouping of errors, their order and their limits."""

from sim.stress.error_causes import Mistake
from sim.stress.worst_moments import MAX_ALIKE, MAX_MOMENTS, file_stem, find_worst


def mistake(frame: int, kind: str = "miss", cause: str = "occluded", person: int | None = 1, track: int | None = None) -> Mistake:
    return Mistake(frame, kind, cause, person, track, (1.0, 2.0, 0.5))


def test_errors_of_consecutive_frames_are_one_moment() -> None:
    found = [mistake(k) for k in (3, 4, 5, 7, 20)] + [mistake(4, person=2)] + [mistake(5, "false positive", "clutter", None, 9)]
    moments = find_worst(found)
    assert [(m.weight, m.first, m.last, m.middle.person, m.middle.track) for m in moments] == [
        (4, 3, 7, 1, None), (1, 4, 4, 2, None), (1, 5, 5, None, 9), (1, 20, 20, 1, None),
    ]  # fmt: skip
    row = moments[0].to_row(["moments/a.png"])
    assert row == {
        "frame": 5, "kind": "miss", "cause": "occluded", "person": 1, "position": [1.0, 2.0, 0.5], "weight": 4, "pictures": ["moments/a.png"],
    }  # fmt: skip
    # The cause of a moment is its most frequent one.
    moments = find_worst([mistake(0), mistake(1, cause="merged"), mistake(2, cause="merged")])
    assert [(m.middle.cause, m.weight, m.middle.frame) for m in moments] == [("merged", 3, 2)]
    assert file_stem(("density/3", 4, "my.module:track")) == "density-3-4-my-module-track"


def test_moments_of_one_kind_and_cause_are_limited() -> None:
    found = [mistake(k, person=p) for p in range(20) for k in range(3)] + [mistake(9, "switch", "new track", 1, 3)]
    moments = find_worst(found)
    assert len(moments) == MAX_ALIKE + 1 <= MAX_MOMENTS
    assert moments[-1].middle.kind == "switch"
