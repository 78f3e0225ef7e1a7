"""Parameters of the multiple-hypothesis tracker."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tracker.detections.ground_points import FusionParameters
from tracker.tracks.calibration_bias import RegistrationBiasParameters
from tracker.tracks.measurement_noise import MeasurementNoiseParameters
from tracker.tracks.parameters import TrackParameters
from tracker.tracks.tracks import MotionParameters


@dataclass(frozen=True)
class MhtParameters(TrackParameters):
    """The parameters of the tracker of people: of its sensors and tracks, and of track trees."""

    motion: MotionParameters = field(default_factory=lambda: MotionParameters(foot_spread=0.2))
    registration_bias: RegistrationBiasParameters = field(
        default_factory=lambda: RegistrationBiasParameters(first=0.05, slope=0.03, slope_first=0.005)
    )
    fusion: FusionParameters = field(default_factory=lambda: FusionParameters(ahead=0.03))
    noise: MeasurementNoiseParameters = field(default_factory=MeasurementNoiseParameters)
    n_scan: float = 10 / 7  # s, age at which N-scan pruning fixes a decision
    clutter: float = 1.0  # least density of false boxes of a view, a steradian
    min_ratio: float = 2.0  # least log-likelihood ratio of a box that a leaf takes
    margin: float = 15.0  # log-likelihood by which a child may be worse than the best child of its leaf
    uncontested_margin: float = 4.0  # the same where no other tree gates the boxes of the best child
    beam_width: int = 8  # partial children of a leaf that go on to the next view
    max_children: int = 3  # children of a leaf, beside those that leave contested boxes to other trees
    tree_leaves: int = 8  # leaves of a tree, at most
    tentative_leaves: int = 4  # the same for a tentative track
    max_loss: float = 30.0  # log-likelihood by which the best hypothesis with a leaf may be worse than the global hypothesis
    patience: int = 4  # ticks for which a tentative track may be outside the global hypothesis
    max_leaves: int = 160  # leaves in all; each has several children, and every two of them are compared
    max_weight: float = 60.0  # largest score from before the N-scan window that counts in a weight
    appearance_weight: float = 0.7  # of the log-likelihood ratio of the appearance model, where there are images
    appearance_rate: float = 0.1  # learning rate of a track's appearance
    learn_partly_visible: bool = True
    supported: float = 0.5  # probability that a box that nobody takes is false, where a box of another view may be of the same person
    report_sigma: float = 1.0  # m, standard deviation of a place from which a coasting person is reported no more
    k_h: int = 25  # K_H, hypotheses that are kept
    i_bls_max: int = 2000  # moves of the local search, at most
    branches: int = 20  # of branch and bound in one component of the graph, at most; they bound the time of a tick
    seed: int = 0  # of the local search
    graphs: Path | None = None  # folder into which every graph is written with the clique that was chosen
    small_graphs: bool = False  # one graph for the children of each hypothesis, in place of one graph of all leaves
    warm: bool = True  # whether the search starts from the surviving tracks, or from a greedy clique
    prove: bool = True  # whether Lagrangian bounds prove the result of the search, or improve it (tracker/clique/set_packing.py)
