"""The scenario file: which robot, which faults, which answers to what nobody knows without a robot."""
