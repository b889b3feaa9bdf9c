"""Inverse elasticity: contact forces from the flow by the small-strain stiffness of the sensor, without training."""
