"""Fit of the actuator model to commanded and measured torque."""
