"""Models run through the same commands with the same policy, and how far they are from the robot."""
