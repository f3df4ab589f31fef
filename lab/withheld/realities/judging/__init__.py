"""Kinds of faults that judge; nothing may be calibrated on them."""
