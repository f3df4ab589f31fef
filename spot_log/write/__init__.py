"""Writing a log from another process without making the control loop wait."""
