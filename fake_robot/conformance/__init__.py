"""What a robot may refuse, as checks that run against any server that claims to be a Spot."""
