"""The plant on an NVIDIA GPU: physics, commands on their way and policies in torch; imported only when asked for."""
