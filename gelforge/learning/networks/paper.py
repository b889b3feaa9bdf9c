"""The article's network: wide layers with sigmoids (Sferrazza et al. 2019, table 2)."""

from __future__ import annotations

import torch
from torch import nn

from gelforge.config import Learning
from gelforge.learning.basis.network import Grids, Network

KEYS = ("hidden", "dropout", "input_form")
# Of the article's table 2 (Sferrazza et al. 2019): its 400 epochs of some 53,700 training rows are 400 times 135 batches.
USUAL = {"learning_rate": 1e-4, "batch_size": 400, "steps": 54_000}
SIGMOID_GAIN = 4.0  # Glorot & Bengio 2010: a sigmoid's slope at 0 is 1/4


def paper_network(features: int, hidden: list[int], outputs: int, dropout: float, seed: int) -> nn.Sequential:
    """Return linear layers with a sigmoid and dropout after each hidden one (Sferrazza et al. 2019, table 2), seeded.

    Glorot's uniform weights: gain 1 into the first layer, whose inputs have unit size, 4 between sigmoids, 1 out of the
    last. Biases start so that a sigmoid at rest (1/2) passes on zero; with PyTorch's own start the signal of three
    sigmoids in a row is some 1e-3 and training at the paper's step size begins with a long plateau.
    """
    generator = torch.Generator().manual_seed(seed)
    widths = [features, *hidden, outputs]
    layers: list[nn.Module] = []
    for number, (fan_in, fan_out) in enumerate(zip(widths, widths[1:])):
        linear = nn.Linear(fan_in, fan_out)
        between = 0 < number < len(widths) - 2
        nn.init.xavier_uniform_(linear.weight, gain=SIGMOID_GAIN if between else 1.0, generator=generator)
        with torch.no_grad():
            linear.bias.copy_(-0.5 * linear.weight.sum(dim=1) if number else torch.zeros(fan_out))
        layers.append(linear)
        if fan_out != outputs or number < len(widths) - 2:
            layers += [nn.Sigmoid(), nn.Dropout(dropout)]
    return nn.Sequential(*layers)


def make(learning: Learning, grids: Grids, seed: int) -> nn.Module:
    """Return the layers of the widths that the study gives."""
    outputs = 3 * grids.bins_x * grids.bins_y
    return paper_network(2 * grids.regions**2, learning.hidden, outputs, learning.dropout, seed)


NETWORK = Network("paper", make, as_article=True)
