"""The training config: its fields with their defaults, and changes by key."""
