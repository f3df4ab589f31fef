"""One run on a robot, from connecting to powering off."""
