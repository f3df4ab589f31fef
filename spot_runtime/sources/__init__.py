"""What a source of commands to the policy is, and how its velocities are shaped."""
