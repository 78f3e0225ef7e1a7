"""Meanings of the words in a report, for readers who have never scored a tracker."""

from __future__ import annotations

BROKEN = 0.5
"""A setting is called broken where the mean MOTA is below this number: errors are then more than half as many as true positions."""
GLOSSARY = (
    ("MOTA", "tracking accuracy: 1 is perfect. Missed people, false people and switched identities lower it; it can be below 0."),
    ("IDF1", "the F1 score of identities, from 0 to 1: how consistently each person keeps one identity."),
    ("ATE", "absolute trajectory error of the robots, in metres: the root mean square distance from their true positions, without alignment."),
    ("Ghost", "a mapped landmark that is half a metre or more from every true one, or a duplicate of another."),
    ("MOTP", "the mean distance of tracks from the people whom they follow, in metres."),
    ("Broken", f"the mean MOTA is below {BROKEN:g}."),
    (
        "0.61 (0.55 to 0.67)",
        "a mean over seeds with its 95 % confidence interval, cut at the bounds of the figure. It is a bootstrap interval (BCa) from 6 seeds on,"
        " and Student's t for fewer.",
    ),
    ("Falls, no difference", "paired differences of the best and the worst setting over seeds, by Student's t with a Bonferroni correction."),
    ("Seed", "the start of the random numbers. Another seed gives other people on other paths; all settings use the same seeds."),
    ("Switch", "an identity switch: a person is tracked under one identity and then under another."),
    ("Limit", "no tracker can follow people whom no robot sees, and no filter is more precise than the Cramér-Rao bound."),
    ("Perfect input", "the run repeated with the truth given to one or more stages. Shapley values divide the loss among the stages."),
)  # fmt: skip

CAUSES = {
    "nobody saw it": "no part of the person was visible in any camera.",
    "occluded": "less than a fifth of the person was visible, even in the best view.",
    "detector missed": "the person was visible, but no box was reported.",
    "not yet believed": "boxes were reported, but the tracker had not yet confirmed the new track.",
    "gated out": "boxes of a tracked person were reported, but the tracker did not assign them to the track.",
    "pose error": "pose errors of the robots that saw the person shifted it by more than half a metre on the ground.",
    "merged": "two people stood near each other, and one track covered both.",
    "clutter": "a track of no person, started by false boxes.",
    "duplicate": "a second track of a person who was tracked already.",
    "coasting": "a track that was predicted onwards without boxes, away from its person.",
    "misplaced": "a track more than a metre from its person, who therefore counts as missed.",
    "wrong association": "the track of one person continued on another.",
    "after occlusion": "the person was occluded for a while and came back under a new identity.",
    "after detector misses": "no box was reported for a while, and the person came back under a new identity.",
    "new track": "the person got a new identity without having been lost.",
}
"""Causes of errors, by the names in the rows."""
