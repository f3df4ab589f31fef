"""The operator's side of the service: `spot-rl ctl`, manual driving, the watch screen."""
