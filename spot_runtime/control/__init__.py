"""The control loop: state in, set-points out, modes and stops."""
