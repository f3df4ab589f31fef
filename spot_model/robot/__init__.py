"""What a Spot is: dimensions, limits, joint order, kinematics, servo law, state types."""
