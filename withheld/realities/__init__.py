"""Robots that share no formula with the effect library or the fake robot: what the diagnosis is judged on."""
