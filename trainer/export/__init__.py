"""Exporting a trained policy to ONNX with its contract."""
