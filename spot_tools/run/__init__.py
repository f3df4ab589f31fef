"""One run from a terminal: `spot-rl run`, what commands its robot, and a log in the robot's place."""
