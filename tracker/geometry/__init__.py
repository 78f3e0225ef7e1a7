"""Rigid motions, cameras, the ground as a height map, and checked arrays.

Read `poses.py` first.
"""

from tracker.geometry.arrays import (
    Array,
    Floats,
    Image,
    Indices,
    Ints,
    Mask,
    check_covariance,
    check_covariances,
    check_unit,
    frozen,
    frozen_ints,
    set_array,
    set_ints,
)
from tracker.geometry.poses import (
    Pose,
    angles_from_bearing,
    bearing_from_angles,
    exp_so3,
    log_so3,
    perturbed_bearings,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_onto,
    rotation_z,
    skew,
    tangent_basis,
    wrap,
)

__all__ = [
    "Array",
    "Floats",
    "Image",
    "Indices",
    "Ints",
    "Mask",
    "Pose",
    "angles_from_bearing",
    "bearing_from_angles",
    "check_covariance",
    "check_covariances",
    "check_unit",
    "exp_so3",
    "frozen",
    "frozen_ints",
    "log_so3",
    "perturbed_bearings",
    "quaternion_from_rotation",
    "rotation_from_quaternion",
    "rotation_onto",
    "rotation_z",
    "set_array",
    "set_ints",
    "skew",
    "tangent_basis",
    "wrap",
]
