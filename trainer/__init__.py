"""Training, export and evaluation of walking policies."""
