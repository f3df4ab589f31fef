"""What the robot's cameras see: the simulated scene, drawn in a process of its own."""
