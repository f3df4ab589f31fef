"""The hardware abstraction: one protocol, and the adapters behind it."""
