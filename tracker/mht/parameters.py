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
    """What both trackers of people have, and what track trees need beside it; boxes below `min_confidence` are not looked at."""

    motion: MotionParameters = field(default_factory=lambda: MotionParameters(foot_spread=0.2))
    offsets: RegistrationBiasParameters = field(default_factory=lambda: RegistrationBiasParameters(first=0.05, slope=0.03, slope_first=0.005))
    fusion: FusionParameters = field(default_factory=lambda: FusionParameters(ahead=0.03))
    noise: MeasurementNoiseParameters = field(default_factory=MeasurementNoiseParameters)
    n_scan: float = 10 / 7  # s, after which a decision stands
    clutter: float = 2.5  # false boxes a steradian that each view is taken to have at least
    least: float = 2.0  # log-likelihood ratio that a box must have to be taken where the best hypothesis goes on otherwise
    width: float = 15.0  # log-likelihood by which a way to go on may be worse than the leaf's best
    slack: float = 4.0  # the same where no other tree wants the boxes of the best way
    beam: int = 8  # ways that are followed from view to view
    children: int = 3  # ways kept of a leaf, beside those that leave a contested box to others
    tree_leaves: int = 8  # leaves kept of a tree
    young_leaves: int = 4  # the same while nobody is believed there
    most_regret: float = 30.0  # log-likelihood by which the best hypothesis with a leaf may be worse than the best of all
    patience: int = 4  # ticks that a young tree may be out of the best hypothesis
    most_leaves: int = 160  # leaves kept in all; each has several children, and every two of them are compared
    most_weight: float = 60.0  # weight that a tree's best leaf has at most
    alike: float = 0.7  # of what images say of what people look like, where there are images (tracker/mht/appearance_model.py) ...
    fashion: float = 0.1  # ... and share by which a box renews how somebody looks
    partly: bool = True
    k_h: int = 25  # K_H, hypotheses kept
    i_bls_max: int = 2000  # moves of the search at most
    branches: int = 20  # of a part that is not settled without; they bound the time of a tick
    seed: int = 0  # of the searches
    graphs: Path | None = None  # where every graph that is solved is written, with the clique that was chosen
    small_graphs: bool = False  # a graph for each hypothesis of the tick before, rather than one of all leaves
    warm: bool = True  # whether the search begins with the tracks that survive, or with the heaviest
    mended: bool = True  # whether what the search finds is proved, or mended, by multipliers (tracker/clique/set_packing.py)
