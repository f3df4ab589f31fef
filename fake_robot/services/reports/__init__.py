"""What the robot reports of itself: state, faults, recorded data."""
