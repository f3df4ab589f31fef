"""An identification from logs to report."""
