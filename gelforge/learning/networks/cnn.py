"""A few convolutions on the grid of bins."""

from __future__ import annotations

import torch
from torch import nn

from gelforge.learning.basis.network import Grids, Network, OnGrids, block, seeded

KEYS = ("channels", "symmetry")
USUAL = {"learning_rate": 3e-3, "batch_size": 32, "steps": 6000}  # errors: `python benchmarks/networks.py`


class ConvolutionalNetwork(OnGrids):
    """Five convolutions on the grid of bins: a small network that sees the neighbourhood of each bin only."""

    def __init__(self, grids: Grids, channels: int):
        super().__init__(grids)
        self.layers = nn.Sequential(block(2, channels), block(channels, 2 * channels))
        self.last = nn.Conv2d(2 * channels, 3, 1)

    def on_grids(self, maps: torch.Tensor) -> torch.Tensor:
        return self.last(self.layers(self.to_bins(maps)))


NETWORK = Network("cnn", seeded(ConvolutionalNetwork))
