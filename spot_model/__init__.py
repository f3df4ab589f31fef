"""What a Spot is: facts, state, control law, policy contract, effects, plant."""

import os

# ONNX Runtime 1.31 keeps a device number in the home folder, starts a thread and sends telemetry, unless told not to.
# Nothing here does so. It stands here because every import of that library comes after an import of this package.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
