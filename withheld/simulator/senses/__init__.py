"""Joint sensors, inertial unit, contact detector, state estimator."""
