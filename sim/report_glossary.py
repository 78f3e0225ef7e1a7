"""What the words of a report mean, for who has never scored a tracker."""

from __future__ import annotations

BROKEN = 0.5
"""A setting is called broken where the mean MOTA is below this: there are more than half as many errors as there are people to follow."""
GLOSSARY = (
    ("MOTA", "tracking accuracy. 1 is perfect; each person missed, each false one and each swapped identity counts against it; it can be below 0."),
    ("IDF1", "how much of the time people keep one identity, from 0 to 1."),
    ("ATE", "how far the robots believe to be from where they are, in metres (root mean square, without alignment)."),
    ("Ghost", "a landmark of the map that is half a metre or more from any true one, or a second copy of one."),
    ("MOTP", "how far the people who are followed are told from where they are, in metres, on average."),
    ("Broken", f"here: a mean MOTA below {BROKEN:g}."),
    ("0.61 (0.55 to 0.67)", "a mean over seeds, and the interval that holds the true mean with 95 % confidence (Student's t)."),
    ("Falls, no difference", "judged seed by seed, best against worst setting, with an interval widened for having chosen those two."),
    ("Seed", "another seed is another crowd on other paths; all settings are tried on the same seeds."),
    ("Switch", "a person who is followed under one identity and then under another."),
    ("Limit", "nobody can follow people whom no robot sees, and no filter is more precise than the Cramér-Rao bound."),
    ("Perfect input", "the run again with one stage or several fed with the truth. The loss is split over stages after Shapley: the parts add up."),
)  # fmt: skip

CAUSES = {
    "nobody saw it": "no camera showed any of the person.",
    "occluded": "less than a fifth of the person was in sight of any camera.",
    "detector missed": "the person was in sight, but no box was reported.",
    "not yet believed": "boxes were there, but the tracker waits for more before it tells of somebody new.",
    "gated out": "boxes were there of somebody known, but the tracker did not take them as theirs.",
    "pose error": "the robots that saw the person were wrong about where they stood, by more than half a metre on the ground.",
    "merged": "two people stood near each other, and one track stood for both.",
    "clutter": "a track of nobody, made of false boxes.",
    "duplicate": "a second track of somebody who was followed already.",
    "coasting": "a track that went on where its person no longer was.",
    "misplaced": "the track of somebody who was missed for it, more than a metre off.",
    "wrong association": "the track of one person went on with another.",
    "after occlusion": "the person was hidden for a while and came back as somebody new.",
    "after detector misses": "no box was reported for a while, and the person came back as somebody new.",
    "new track": "the person got another identity without having been lost.",
}
"""Causes of errors, by the names in the rows."""
