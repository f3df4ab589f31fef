"""Sources of velocity commands: scripted, keyboard, gamepad."""
