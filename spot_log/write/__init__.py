"""Writing a log from another process without making the control loop wait, and the live view of it."""
