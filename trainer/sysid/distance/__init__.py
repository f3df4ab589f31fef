"""Distances between distributions of robot and simulator signals."""
