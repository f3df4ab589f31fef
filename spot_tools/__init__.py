"""Programs beside the runtime, for those who operate a robot, prepare its computer, or choose what it runs."""
