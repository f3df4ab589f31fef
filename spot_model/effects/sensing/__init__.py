"""Effects on what the sensors and the state estimator report."""
