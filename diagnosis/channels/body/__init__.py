"""Channels of the body: loads against motion, feet against the ground, the inertial unit."""
