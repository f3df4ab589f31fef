"""Faults that nobody listed: drawn, varied towards the worst end, and judged by laws that hold whatever happens."""
