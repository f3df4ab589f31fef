"""The deployed service: it drives a robot with a policy, keeps it safe, and logs all of it."""
