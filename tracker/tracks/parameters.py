"""Parameters of the tracker of people: sensors, motion, gates, the life of tracks, and track trees."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tracker.detections.ground_points import FusionParameters
from tracker.tracks.calibration_bias import RegistrationBiasParameters
from tracker.tracks.detection_rates import DetectionRateParameters
from tracker.tracks.measurement_noise import MeasurementNoiseParameters
from tracker.tracks.reidentification import ReidentificationParameters
from tracker.tracks.tracks import MotionParameters
from tracker.types import Setup


@dataclass(frozen=True)
class MhtParameters:
    """Names are those of Yoo et al. 2017 where it has them. Times are in seconds, so that they hold at any frame rate."""

    fusion: FusionParameters = field(default_factory=FusionParameters)
    motion: MotionParameters = field(default_factory=MotionParameters)
    detection_rates: DetectionRateParameters = field(default_factory=DetectionRateParameters)
    reidentification: ReidentificationParameters = field(default_factory=ReidentificationParameters)
    registration_bias: RegistrationBiasParameters = field(default_factory=RegistrationBiasParameters)
    noise: MeasurementNoiseParameters = field(default_factory=MeasurementNoiseParameters)
    standing_clutter: bool = True  # whether places where false boxes stay are learned
    arrival_rate: float = 2e-4  # new people per square metre and revisit of the cameras
    clutter: float = 1.0  # least density of false boxes of a view, per steradian
    least_fit: float = 0.0  # least log-likelihood ratio of a box for a leaf, computed with the highest confidence of the view
    gate: float = 4.0  # standard deviations of the innovation
    delta_a: float = 9 / 7  # s, longest gap of a track that is bridged
    coasting_factor: float = 3.0  # times delta_a: time for which a track without boxes coasts unreported before its deletion
    n_conf: int = 2  # least number of ticks with a box before a track is confirmed
    residence: float = 60.0  # s, mean time for which a track follows one person
    miss_time: float = 0.5  # s in which the missed detections of a person have one cause and count once against existence
    body: float = 0.3  # m, mean distance in the memory of two tracks below which they exclude each other
    report: float = 0.98  # probability of existence from which a track is confirmed
    thing: float = 0.85  # probability that a track is a thing that looks like a person, above which it is not reported
    forget: float = 5e-4  # probability of existence below which a track is deleted
    joint_misses: float = 2.0  # greatest number of misses for which a miss in all views at once counts, as its cause is common
    n_scan: float = 10 / 7  # s, age at which N-scan pruning fixes a decision
    margin: float = 15.0  # log-likelihood by which a child may be worse than the best child of its leaf
    uncontested_margin: float = 4.0  # the same where no other tree takes a box of the best child
    beam_width: int = 8  # partial children of a leaf that go on to the next view
    max_children: int = 3  # children of a leaf, beside those that leave contested boxes to other trees
    tree_leaves: int = 8  # greatest number of leaves of a tree
    tentative_leaves: int = 4  # the same for a tentative track
    max_loss: float = 30.0  # log-likelihood by which the best hypothesis with a leaf may be worse than the global hypothesis
    max_leaves: int = 160  # greatest number of leaves in all; every pair of their children is compared
    k_h: int = 1  # K_H, hypotheses that are kept; above 1, the children of each form a graph of their own
    i_bls_max: int = 2000  # moves of the local search, at most
    branches: int = 60  # of branch and bound in one component of the graph, at most; they bound the time of a tick
    seed: int = 0  # of the local search

    def over(self, setup: Setup) -> MhtParameters:
        """These parameters with `fusion.over` the setup."""
        return replace(self, fusion=self.fusion.over(setup))
