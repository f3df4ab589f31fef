"""The robot as a whole: modes of operation over the simulated body."""
