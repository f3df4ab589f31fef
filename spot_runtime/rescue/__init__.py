"""A robot whose control process died: the note by which it is found, who watches for it, and what makes it safe."""
