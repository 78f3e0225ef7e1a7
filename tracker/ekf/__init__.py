"""The mathematics of the filter: the joint state with one covariance, retractions, measurement models, Jacobians and biases.

Read `state.py` first."""
