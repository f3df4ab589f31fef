"""Faults by family; each is a function from a generator, a size and joints to a change of a robot."""
