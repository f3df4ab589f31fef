"""Admission of policies: signatures, checks, `spot-rl policy`."""
