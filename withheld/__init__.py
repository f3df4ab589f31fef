"""Judges the diagnosis on realities that it has never seen: seals cases, runs it blind, opens the seals, scores."""
