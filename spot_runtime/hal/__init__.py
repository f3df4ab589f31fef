"""The hardware abstraction: one protocol, and the adapters behind it."""

import os

# gRPC's own log repeats on the terminal, without context, what our errors say; it is read when gRPC is first imported.
os.environ.setdefault("GRPC_VERBOSITY", "NONE")
