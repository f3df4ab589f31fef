"""System identification: the paper's measures and search over logs of a robot, and what the logged torques add."""
