"""Limits and watchdogs of the control loop."""
