"""What a network is, and what networks on grids share.

Every network takes inputs (n, 2 r^2), the two components of the flow (or its magnitudes and directions) by region, row by
row, and returns (n, 3 B), the three components of each bin, as Scaling has them. One that reads the inverse takes the forces
of inverse elasticity (3 B) after them. The networks are in `networks`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from gelforge.config import Learning


class Grids(NamedTuple):
    """The grid of image regions that a network reads, and that of bins which it writes."""

    regions: int  # along each side
    bins_x: int
    bins_y: int


@dataclass(frozen=True)
class Network:
    """One network: `make(learning, grids, seed)` returns it with seeded weights."""

    name: str
    make: Callable[[Learning, Grids, int], nn.Module]
    # Trained as the article did: inputs by their mean and deviation, every image in each pass, a steady step size without
    # weight decay, nothing turned or mirrored.
    as_article: bool = False
    reads_inverse: bool = False  # its inputs end with the forces of inverse elasticity


def seeded(kind: Callable[[Grids, int], OnGrids]) -> Callable[[Learning, Grids, int], nn.Module]:
    """Return the `make` of a network on grids with learning.channels channels."""

    def make(learning, grids, seed):
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            network = kind(grids, learning.channels)
            start(network)
            # faster on a CPU; PyTorch's types do not know the keyword
            return network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    return make


def start(network: nn.Module) -> None:
    """Draw the kernels of convolutions so that a signal keeps its size from layer to layer (He et al. 2015).

    The layer `last` becomes zero: a training starts from no force, or from the forces of inverse elasticity.
    """
    for layer in network.modules():
        if isinstance(layer, nn.Conv2d):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]  # convolutions here have one
    if isinstance(last := getattr(network, "last", None), nn.Conv2d):
        nn.init.zeros_(last.weight)


class OnGrids(nn.Module):
    """Vectors of regions in, vectors of bins out, grids between."""

    def __init__(self, grids: Grids):
        super().__init__()
        self.grids = grids

    def on_grids(self, maps: torch.Tensor) -> torch.Tensor:
        """Return the forces (n, 3, ny, nx) of maps of flow (n, 2, r, r); every network defines it."""
        raise NotImplementedError

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        regions = self.grids.regions
        maps = self.on_grids(inputs.reshape(-1, 2, regions, regions))  # (n, 3, ny, nx)
        return maps.permute(0, 2, 3, 1).flatten(1)

    def to_bins(self, maps: torch.Tensor) -> torch.Tensor:
        """Return maps on the grid of bins, where they are on another."""
        return resized(maps, (self.grids.bins_y, self.grids.bins_x))


def block(before: int, after: int) -> nn.Sequential:
    """Return two convolutions; nothing is normalised, as the size of the flow gives the size of the force."""
    first, second = nn.Conv2d(before, after, 3, padding=1), nn.Conv2d(after, after, 3, padding=1)
    return nn.Sequential(first, nn.SiLU(), second, nn.SiLU())


def resized(maps: torch.Tensor, size: Sequence[int]) -> torch.Tensor:
    """Return maps (n, c, y, x) on a grid of another size (y, x)."""
    y, x = size
    if tuple(maps.shape[-2:]) == (y, x):
        return maps
    if all(there <= here for there, here in zip(size, maps.shape[-2:])):
        return functional.adaptive_avg_pool2d(maps, (y, x))  # no place is left out
    return functional.interpolate(maps, size=(y, x), mode="bilinear", align_corners=False)
