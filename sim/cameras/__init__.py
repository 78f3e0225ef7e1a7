"""Camera models of rovers and fixed cameras, from a text such as `dual-fisheye:fov=200,baseline=0.02` to the views that are recorded.

Read `rig.py` first."""

from sim.cameras.rig import EQUIRECTANGULAR, CameraSpecification, Rig, RigView, parse_camera

__all__ = ["EQUIRECTANGULAR", "CameraSpecification", "Rig", "RigView", "parse_camera"]
