"""Robot logs as identification reads them."""
