"""The U-Net with the forces of inverse elasticity as three more channels, which it corrects."""

from __future__ import annotations

import torch
from torch import nn

from gelforge.learning.basis.network import Grids, Network, seeded
from gelforge.learning.networks.unet import UNet

KEYS = ("channels", "symmetry")
USUAL = {"learning_rate": 3e-3, "batch_size": 32, "steps": 6000}  # errors: `python benchmarks/networks.py`


class UNetInverse(UNet):
    """The forces of inverse elasticity, times a factor of each component that is learnt, and what the U-Net adds to them."""

    def __init__(self, grids: Grids, channels: int):
        super().__init__(grids, channels, more=3)
        self.skip = nn.Parameter(torch.ones(3))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        regions, bins_x, bins_y = self.grids
        flow, forces = inputs.split([2 * regions**2, 3 * bins_x * bins_y], dim=1)
        forces = forces.reshape(-1, bins_y, bins_x, 3).permute(0, 3, 1, 2)
        maps = self.on_grids(flow.reshape(-1, 2, regions, regions), forces)
        return (maps + self.skip[:, None, None] * forces).permute(0, 2, 3, 1).flatten(1)


NETWORK = Network("unet_inverse", seeded(UNetInverse), reads_inverse=True)
