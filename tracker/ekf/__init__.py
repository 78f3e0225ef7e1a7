"""The extended Kalman filter: the joint state with one covariance, retractions, measurement models, their Jacobians and odometry biases.

Read `state.py` first.
"""
