"""Evaluation of policies on the CPU plant: trials, figures, a page and a video."""
