"""Runs side by side: a log against a log, or against a simulation of the same commands."""
