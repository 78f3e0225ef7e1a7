"""The extended Kalman filter: the joint state with one covariance, retractions, measurement models, their Jacobians and odometry biases.

Read `state.py` first.
"""

from tracker.ekf.odometry_biases import BiasModel
from tracker.ekf.state import JointState

__all__ = ["BiasModel", "JointState"]
