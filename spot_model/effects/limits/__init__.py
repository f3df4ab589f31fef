"""Limits on torque and power."""
