"""Logs in: files, checks, missing signals completed, one even grid of states."""
