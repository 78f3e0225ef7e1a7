"""Parameters of the multi-robot EKF-SLAM filter (tracker.slam.filter)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from tracker.ekf.odometry_biases import BiasModel
from tracker.slam.data_association import Gate
from tracker.slam.features import Extraction
from tracker.slam.landmark_initialization import InitializationParameters
from tracker.slam.landmark_map import PruningParameters
from tracker.slam.resection import Search


@dataclass(frozen=True)
class SlamParameters:
    """mode: iekf, the iterated filter (with one iteration the plain one), fej or invariant (joint.Joint). iterations: linearisations of an
    update. correction: keep a correction factor a robot; correction_sigma rad about x, y, z at the start,
    correction_walk rad an axis a square root of a second. level_memory, turn_memory s: errors of the accelerometer's "up" and of the odometry's turns
    hang together for so long, and are believed the less. persistence: what of them lasts is kept in the state, in the place of turn_memory (None:
    nothing is; not for invariant). robust: residuals beyond so many standard deviations lose weight (inf: never).

    seen: landmarks a camera updates at once; capacity: landmarks in the map; growth: new ones a camera a tick. clones: earlier poses kept a robot,
    a new one each `stride` m. robot_radius m: nothing without a name becomes or matches a landmark so near to another robot's middle. reopen: a
    robot's pose is doubted by reopen_sigma (m, rad) where most of the landmarks seen in the last `reopen` ticks, or of the robots, are refused.
    """

    mode: str = "invariant"
    iterations: int = 2
    correction: bool = True
    correction_sigma: tuple[float, float, float] = (0.012, 0.012, 0.004)
    correction_walk: float = 0.0005
    level_memory: float = 1.0
    turn_memory: float = 0.2
    persistence: BiasModel | None = None
    robust: float = 3.0
    seen: int = 32
    growth: int = 12
    capacity: int = 240
    clones: int = 4
    stride: float = 0.2
    robot_radius: float = 0.45
    reopen: int = 4
    reopen_sigma: tuple[float, float] = (0.1, 0.03)
    gate: Gate = field(default_factory=Gate)
    trial: InitializationParameters = field(default_factory=InitializationParameters)
    survival: PruningParameters = field(default_factory=PruningParameters)
    extraction: Extraction = field(default_factory=Extraction)
    search: Search = field(default_factory=Search)

    def __post_init__(self) -> None:
        if self.mode not in ("iekf", "fej", "invariant"):
            raise ValueError(f"mode is {self.mode!r}, needs iekf, fej or invariant")
        if self.mode == "invariant" and self.persistence is not None:
            raise ValueError("mode is 'invariant', needs fej or iekf where persistence is kept")
        for name in ("iterations", "clones", "capacity", "seen"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} is {getattr(self, name)}, needs at least 1")

    def persistent(self) -> SlamParameters:
        """With lasting errors of the odometry in the state, and first-estimates Jacobians, which go well with it: NEES is near one so. For wheels
        that slip; where errors are new at every tick it is no better.
        """
        return replace(self, mode="fej", persistence=BiasModel())
