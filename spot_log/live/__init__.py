"""The live view: what the log's process writes, shown in Foxglove while it happens, by a process of its own."""
