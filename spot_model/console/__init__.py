"""The command line spot-rl: its commands, their progress, and the options that they share."""
