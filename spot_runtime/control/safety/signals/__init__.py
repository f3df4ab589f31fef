"""Whether the robot's signals can be true: against each other, against what is sent, and against physics."""
