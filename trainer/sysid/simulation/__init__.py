"""Simulated runs to compare with the logs."""
