"""Robots with faults, composed from catalogues of kinds."""
