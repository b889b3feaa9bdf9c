"""What was learnt: the loss over epochs, errors of predictions."""
