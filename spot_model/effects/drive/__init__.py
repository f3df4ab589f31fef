"""Effects in the motors and gears."""
