"""Starting a fake robot: command line, certificates, server, real-time pacing."""
