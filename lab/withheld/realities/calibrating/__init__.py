"""Kinds of faults on which anything may be calibrated; they share nothing but the simulator with those that judge."""
