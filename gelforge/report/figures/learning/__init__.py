"""What was learnt: the loss over steps, errors of predictions."""
