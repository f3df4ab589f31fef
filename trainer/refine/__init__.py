"""A trained policy made better by a few gains around its network, searched in whole-gait trials."""
