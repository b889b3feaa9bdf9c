"""Models outside PyTorch: ONNX, and prediction in real time."""
