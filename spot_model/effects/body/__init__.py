"""Effects on the rigid bodies and the ground."""
