"""The next experiment: what to run on the robot so that one cause is left."""
