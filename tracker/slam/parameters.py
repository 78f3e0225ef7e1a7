"""Parameters of the multi-robot EKF-SLAM filter (tracker.slam.filter)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tracker.ekf.odometry_biases import BiasModel
from tracker.slam.data_association import Gate
from tracker.slam.features import FeatureParameters
from tracker.slam.landmark_initialization import InitializationParameters
from tracker.slam.landmark_map import DriftModel, PruningParameters
from tracker.slam.resection import RelocalizationParameters


@dataclass(frozen=True)
class SlamParameters:
    """Parameters of the filter.

    mode: iekf, the iterated filter (with one iteration the plain one), or fej (ekf.state.JointState). iterations: linearisations of an update.
    correction: estimate a correction factor per robot. correction_sigma rad: its initial deviation about x, y, z. correction_walk: its random walk,
    rad/√s per axis. gravity_correlation_time and rotation_correlation_time s: correlation times of errors of "up" and of
    the odometry's rotation, for which the variances are inflated. odometry_biases: estimate these errors as states, without
    rotation_correlation_time (None: do not). feature_drift: correlated errors of features of images (None: all are white). robust: standard
    deviations of a residual beyond which it loses weight.

    max_updates: landmarks in one update by a camera. max_new_landmarks: per camera and tick. capacity: landmarks in the map. clones: earlier poses
    kept per robot, one every `clone_spacing` m. robot_radius m: unnamed sightings within this distance of another robot's centre are ignored.
    recent_ticks, inflation_sigma (m, rad): a robot's pose covariance is inflated if most landmarks seen in the last ticks are rejected, or
    most robots.
    """

    mode: str = "fej"
    iterations: int = 2
    correction: bool = True
    correction_sigma: tuple[float, float, float] = (0.012, 0.012, 0.004)
    correction_walk: float = 0.0005
    gravity_correlation_time: float = 1.0
    rotation_correlation_time: float = 0.2
    odometry_biases: BiasModel | None = None
    feature_drift: DriftModel | None = None
    robust: float = 3.0
    max_updates: int = 32
    max_new_landmarks: int = 12
    capacity: int = 240
    clones: int = 4
    clone_spacing: float = 0.2
    robot_radius: float = 0.45
    recent_ticks: int = 4
    inflation_sigma: tuple[float, float] = (0.1, 0.03)
    gate: Gate = field(default_factory=Gate)
    initialization: InitializationParameters = field(default_factory=InitializationParameters)
    pruning: PruningParameters = field(default_factory=PruningParameters)
    features: FeatureParameters = field(default_factory=FeatureParameters)
    relocalization: RelocalizationParameters = field(default_factory=RelocalizationParameters)

    def __post_init__(self) -> None:
        if self.mode not in ("iekf", "fej"):
            raise ValueError(f"mode is {self.mode!r}, needs iekf or fej")
        for name in ("iterations", "clones", "capacity", "max_updates"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, needs at least 1")
        if self.capacity < (new := min(self.max_new_landmarks, self.max_updates)):
            raise ValueError(f"capacity is {self.capacity}, needs at least the {new} new landmarks of a tick (max_new_landmarks)")

    def with_odometry_biases(self) -> SlamParameters:
        """With odometry biases as states and drift of image features, with which NEES is near one.

        Meant for wheels that slip and for features of images; it has no advantage where errors are independent from tick to tick.
        Wrong matches of images are frequent, so a residual loses weight beyond two standard deviations.
        """
        return replace(self, odometry_biases=BiasModel(), feature_drift=DriftModel(), robust=2.0)
