"""Programs beside the runtime, for those who operate a robot, prepare its computer, or choose what it runs."""

import os

# gRPC's own log repeats on the terminal, without context, what our errors say; it is read when gRPC is first imported.
os.environ.setdefault("GRPC_VERBOSITY", "NONE")
