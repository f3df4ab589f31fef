"""Ordinary runs on robots, ground and links that are drawn anew each time: nothing may stop them."""
