"""Choosing: candidates simulated on robots that the logs allow, checked, and ranked by what they tell."""
