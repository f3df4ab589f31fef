"""Collecting logs on a robot: command sequences and repeats."""
