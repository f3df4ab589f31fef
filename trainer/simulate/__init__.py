"""The one engine: models under policies and commands, on the cores, on a GPU, or on many machines."""
