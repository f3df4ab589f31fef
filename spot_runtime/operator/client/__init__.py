"""The operator's side: `spot-rl ctl`, manual driving, the watch screen."""
