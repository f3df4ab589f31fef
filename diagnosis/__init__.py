"""Explains a gap between a reality and a simulator: where it lies, which effect makes it, and how much of it."""
