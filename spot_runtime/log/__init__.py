"""The log: what the loop hands over, the process that writes it, and what reads it."""
