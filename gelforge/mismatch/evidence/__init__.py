"""What a model of the readings may consist of, their covariance, and the evidence of linear changes of them."""
