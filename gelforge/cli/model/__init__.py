"""Commands of the network: train it, judge it, export it, predict with it."""
