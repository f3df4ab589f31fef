"""A fake robot, and runs on it in which something goes wrong: what every bench of the runtime's conduct is built on."""
