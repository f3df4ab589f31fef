"""Commands on logs: summary, export, pruning."""
