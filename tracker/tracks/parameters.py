"""Parameters that both trackers of people share."""

from __future__ import annotations

from dataclasses import dataclass, field

from tracker.detections.ground_points import FusionParameters
from tracker.tracks.calibration_bias import RegistrationBiasParameters
from tracker.tracks.detection_rates import DetectionRateParameters
from tracker.tracks.reidentification import ReidentificationParameters
from tracker.tracks.tracks import MotionParameters


@dataclass(frozen=True)
class TrackParameters:
    """Named as in the paper where it has a name for it; times in seconds, so that other frame rates work."""

    fusion: FusionParameters = field(default_factory=FusionParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    trust: DetectionRateParameters = field(default_factory=DetectionRateParameters)
    reunion: ReidentificationParameters = field(default_factory=ReidentificationParameters)
    min_confidence: float = 0.6  # boxes below say nothing of whether there is anybody, but keep those who are known from others' boxes ...
    least_confidence: float = 0.4  # ... and below this they are not looked at
    birth_confidence: float = 0.8  # and below this they start nobody
    arrivals: float = 2e-4  # people who appear, a square metre and tick ...
    present: float = 2e-2  # ... and who are there at the start, a square metre
    most_gain: float = 6.0  # log-likelihood ratio that one box counts at most
    alone: float = 2.0  # log-likelihood ratio for one person, at most, of a tick in which views see but one of two tracks ...
    apart: float = 0.8  # ... and share of what a view's second box is worth that speaks for two
    duplicate: float = 10.0  # log-likelihood ratio from which two tracks are one person
    gate: float = 4.0  # standard deviations of the innovation
    delta_a: float = 9 / 7  # s, longest gap that is bridged ...
    followed: float = 3.0  # ... and so many times as long people are followed of whom nothing is told: they are still where nobody looks
    unsure: float = 0.3  # m, standard deviation of a place from which on it is asked of many where views could see somebody
    n_conf: int = 2  # frames until a track may be believed
    believe: float = 4.0  # score from which it is
    forget: float = -8.0  # score below which a young track is dropped
    end: float = -5.0  # the same for one that was believed
    most_score: float = 20.0  # what is known of somebody counts at most so much against what is seen now
    at_once: float = 2.0  # misses that all views' missing somebody at once is worth, at most
    surely: float = 0.6  # m, standard deviation of a place up to which a box without feet is taken
    before: float = 0.3  # share of those without a box who stand before somebody else's, whose corners are theirs then
    outside: float = 3 / 7  # s, after which somebody is gone who is out of all views
    partly: bool = False  # whether it is learned how often views find people of whom a part is covered (tracker/detections/occlusion.py)
    same_person: float = 1.0  # m, two tracks nearer than this that no view tells apart are one person
    offsets: RegistrationBiasParameters = field(default_factory=RegistrationBiasParameters)
