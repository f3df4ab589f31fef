"""Training with rsl-rl's PPO."""
