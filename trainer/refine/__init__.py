"""Refinement of a trained policy: a search over a few gains around its network, judged by whole-gait trials."""
