"""Covariance of the readings, and the evidence of linear changes of them."""
