"""The policy file: ONNX, its contract, its observation."""
