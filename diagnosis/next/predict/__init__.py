"""Predictions: what the robot will do on a command that was never run."""
