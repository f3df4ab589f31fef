"""Speed of system identification."""
