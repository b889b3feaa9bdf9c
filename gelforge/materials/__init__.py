"""Raw material tests to a law with its covariance."""
