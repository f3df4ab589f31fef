"""A policy on a simulated robot, in a window or as a film."""
