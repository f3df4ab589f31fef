"""Robot commands and joint control."""
