"""From logs to a better policy: diagnose, identify, retrain, evaluate beside the old one, tell."""
