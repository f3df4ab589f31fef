"""Reading logs, also those that were cut short."""
