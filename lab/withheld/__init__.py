"""Judges the diagnosis on realities that it has never seen: draws cases, runs it blind, scores."""
