"""Channels of the drive: what was asked of a joint against what it gave, its sensors and its supply."""
