"""The simulated body: physics, drives, energy, sensors, in robot time."""
