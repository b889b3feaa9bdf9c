"""The network that predicts the force distribution."""
