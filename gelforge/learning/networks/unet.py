"""A U-Net from the grid of regions to the grid of bins."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from gelforge.learning.basis.network import Grids, Network, OnGrids, block, resized, seeded

KEYS = ("channels", "symmetry")
USUAL = {"learning_rate": 3e-3, "batch_size": 32, "steps": 6000}  # errors: `python benchmarks/networks.py`


class UNet(OnGrids):
    """Grids of half the places each, down to a few places along a side, and back to the grid next to the bins' from above.

    What a region of the image shows moves the forces of bins near it most, and those of all others through equilibrium: fine
    grids carry the one, the coarse ones the other (Ronneberger, Fischer & Brox 2015). Four neighbouring regions are first
    folded into the channels of one place, where the bins are no finer than that: most of the work is on the finest grid.
    """

    COARSEST = 6  # places along a side

    def __init__(self, grids: Grids, channels: int, more: int = 0):
        """more: maps that join those of the flow on the finest grid."""
        super().__init__(grids)
        bins = max(grids.bins_x, grids.bins_y)
        self.fold = 2 if grids.regions % 2 == 0 and grids.regions // 2 >= bins else 1
        sizes = [grids.regions // self.fold]
        while sizes[-1] > self.COARSEST:
            sizes.append(-(-sizes[-1] // 2))
        widths = [channels, *[2 * channels] * (len(sizes) - 1)]
        self.down = nn.ModuleList(
            [block(before, after) for before, after in zip([2 * self.fold**2 + more, *widths], widths)]
        )
        ends_at = max((level for level, size in enumerate(sizes) if size >= bins), default=0)
        self.back = range(len(sizes) - 2, ends_at - 1, -1)  # the levels on the way back
        up, width = [], widths[-1]
        for level in self.back:
            up.append(block(width + widths[level], channels))
            width = channels
        self.up = nn.ModuleList(up)
        self.last = nn.Conv2d(width, 3, 1)

    def on_grids(self, maps: torch.Tensor, more: torch.Tensor | None = None) -> torch.Tensor:
        maps, passed = functional.pixel_unshuffle(maps, self.fold), []
        if more is not None:
            maps = torch.cat([maps, resized(more, maps.shape[-2:])], dim=1)
        for level, down in enumerate(self.down):
            maps = down(functional.avg_pool2d(maps, 2, ceil_mode=True) if level else maps)
            passed.append(maps)
        for level, up in zip(self.back, self.up):
            maps = up(torch.cat([passed[level], resized(maps, passed[level].shape[-2:])], dim=1))
        return self.last(self.to_bins(maps))


NETWORK = Network("unet", seeded(UNet))
