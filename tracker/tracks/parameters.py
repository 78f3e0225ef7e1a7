"""Parameters of sensors, motion, gates, and the life of tracks."""

from __future__ import annotations

from dataclasses import dataclass, field

from tracker.detections.ground_points import FusionParameters
from tracker.tracks.calibration_bias import RegistrationBiasParameters
from tracker.tracks.crowding import CrowdingParameters
from tracker.tracks.detection_rates import DetectionRateParameters
from tracker.tracks.reidentification import ReidentificationParameters
from tracker.tracks.standing_clutter import StandingClutterParameters
from tracker.tracks.tracks import MotionParameters


@dataclass(frozen=True)
class TrackParameters:
    """Names are those of Yoo et al. 2017 where it has one. Times are in seconds, so that they hold at any frame rate."""

    fusion: FusionParameters = field(default_factory=FusionParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    detection_rates: DetectionRateParameters = field(default_factory=DetectionRateParameters)
    reidentification: ReidentificationParameters = field(default_factory=ReidentificationParameters)
    crowding: CrowdingParameters = field(default_factory=CrowdingParameters)
    standing_clutter: StandingClutterParameters = field(default_factory=StandingClutterParameters)
    usable: tuple[float, float] = (0.6, 0.15)  # probability of a person, as given and as learned, below which a box is ignored
    initiation: tuple[float, float] = (0.8, 0.5)  # the same, below which a box initiates no track
    arrival_rate: float = 2e-4  # new people, a square metre and tick
    initial_density: float = 2e-2  # people in the first tick, a square metre
    max_gain: float = 6.0  # greatest log-likelihood ratio of one box
    merge_step: float = 2.0  # greatest log-likelihood ratio for one person of a tick in which each view sees at most one of two tracks
    split_share: float = 0.8  # share of the ratio of a second box in one view that counts against one person
    merge_score: float = 10.0  # log-likelihood ratio above which two tracks are one person
    merge_distance: float = 1.0  # m, greatest distance of two tracks that may be one person (theta_s); less in crowds (crowding.py)
    gate: float = 4.0  # standard deviations of the innovation
    delta_a: float = 9 / 7  # s, longest gap of a track that is bridged
    coasting_factor: float = 3.0  # of delta_a, time for which a track without boxes coasts before its deletion, unreported
    sampling_sigma: float = 0.3  # m, standard deviation of a place above which visibility is averaged over a grid
    n_conf: int = 2  # frames with a box before a track may be confirmed
    confirm_score: float = 4.0  # existence score from which a track is confirmed
    delete_tentative_score: float = -8.0  # existence score below which a tentative track is deleted
    delete_confirmed_score: float = -5.0  # existence score below which a confirmed track is deleted
    max_score: float = 20.0  # greatest existence score
    joint_misses: float = 2.0  # missed detections for which a miss in all views at once counts at most, as its cause is common
    covering_share: float = 0.3  # probability that a person without a box stands before another one's box, whose corners then are theirs
    max_outside: float = 3 / 7  # s outside all views after which a person is gone
    learn_partly_visible: bool = False  # whether detection rates of partly visible people are learned (detections/occlusion.py)
    registration_bias: RegistrationBiasParameters = field(default_factory=RegistrationBiasParameters)
