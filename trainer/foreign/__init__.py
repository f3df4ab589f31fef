"""Policies of other frameworks, in and out: Isaac Lab, mjlab, spot-rl-example."""
