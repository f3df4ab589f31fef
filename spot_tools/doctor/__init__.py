"""What a first run needs, checked one by one, with what to do about each failure. Nothing moves or claims a robot."""
