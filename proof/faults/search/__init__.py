"""Unlisted faults: drawn, varied towards the worst end, and judged by laws that always hold."""
