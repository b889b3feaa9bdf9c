"""The networks by name: from scaled flow features of an image to scaled forces of the bins.

Every network takes inputs (n, 2 r^2), the two components of the flow (or its magnitudes and directions) by region, row by
row, and returns (n, 3 B), the three components of each bin, as Scaling has them.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import nn
from torch.nn import functional

from gelforge.config import Learning

SIGMOID_GAIN = 4.0  # Glorot & Bengio 2010: a sigmoid's slope at 0 is 1/4


class Grids(NamedTuple):
    """The grid of image regions that a network reads, and that of bins which it writes."""

    regions: int  # along each side
    bins_x: int
    bins_y: int


def make_network(learning: Learning, grids: Grids, seed: int) -> nn.Module:
    """Return the network that learning.network names, seeded."""
    if learning.network == "paper":
        outputs = 3 * grids.bins_x * grids.bins_y
        return paper_network(2 * grids.regions**2, learning.hidden, outputs, learning.dropout, seed)
    make = {"unet": UNet, "cnn": ConvolutionalNetwork}[learning.network]
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return make(grids, learning.channels).to(memory_format=torch.channels_last)  # faster on a CPU


# ------------------------------------------------------------------------------------------------- the article's
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


# ------------------------------------------------------------------------------------------------- convolutional
class _OnGrids(nn.Module):
    """Vectors of regions in, vectors of bins out, grids between."""

    def __init__(self, grids: Grids):
        super().__init__()
        self.grids = grids

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        regions = self.grids.regions
        maps = self.on_grids(inputs.reshape(-1, 2, regions, regions))  # (n, 3, ny, nx)
        return maps.permute(0, 2, 3, 1).flatten(1)

    def to_bins(self, maps: torch.Tensor) -> torch.Tensor:
        """Return maps on the grid of bins, where they are on another."""
        return _resized(maps, (self.grids.bins_y, self.grids.bins_x))


class UNet(_OnGrids):
    """Grids of half the places each, down to a few places along a side, and back to the grid next to the bins' from above.

    What a region of the image shows moves the forces of bins near it most, and those of all others through equilibrium: fine
    grids carry the one, the coarse ones the other (Ronneberger, Fischer & Brox 2015). Four neighbouring regions are first
    folded into the channels of one place, where the bins are no finer than that: most of the work is on the finest grid.
    """

    COARSEST = 6  # places along a side

    def __init__(self, grids: Grids, channels: int):
        super().__init__(grids)
        bins = max(grids.bins_x, grids.bins_y)
        self.fold = 2 if grids.regions % 2 == 0 and grids.regions // 2 >= bins else 1
        sizes = [grids.regions // self.fold]
        while sizes[-1] > self.COARSEST:
            sizes.append(-(-sizes[-1] // 2))
        widths = [channels, *[2 * channels] * (len(sizes) - 1)]
        self.down = nn.ModuleList(
            [_block(before, after) for before, after in zip([2 * self.fold**2, *widths], widths)]
        )
        ends_at = max((level for level, size in enumerate(sizes) if size >= bins), default=0)
        self.back = range(len(sizes) - 2, ends_at - 1, -1)  # the levels on the way back
        up, width = [], widths[-1]
        for level in self.back:
            up.append(_block(width + widths[level], channels))
            width = channels
        self.up = nn.ModuleList(up)
        self.last = nn.Conv2d(width, 3, 1)

    def on_grids(self, maps: torch.Tensor) -> torch.Tensor:
        maps, passed = functional.pixel_unshuffle(maps, self.fold), []
        for level, block in enumerate(self.down):
            maps = block(functional.avg_pool2d(maps, 2, ceil_mode=True) if level else maps)
            passed.append(maps)
        for level, block in zip(self.back, self.up):
            maps = block(torch.cat([passed[level], _resized(maps, passed[level].shape[-2:])], dim=1))
        return self.last(self.to_bins(maps))


class ConvolutionalNetwork(_OnGrids):
    """Five convolutions on the grid of bins: a small network that sees the neighbourhood of each bin only."""

    def __init__(self, grids: Grids, channels: int):
        super().__init__(grids)
        self.layers = nn.Sequential(
            _block(2, channels), _block(channels, 2 * channels), nn.Conv2d(2 * channels, 3, 1)
        )

    def on_grids(self, maps: torch.Tensor) -> torch.Tensor:
        return self.layers(self.to_bins(maps))


def _block(before: int, after: int) -> nn.Sequential:
    """Return two convolutions; nothing is normalised, as the size of the flow gives the size of the force."""
    first, second = nn.Conv2d(before, after, 3, padding=1), nn.Conv2d(after, after, 3, padding=1)
    return nn.Sequential(first, nn.ReLU(), second, nn.ReLU())


def _resized(maps: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    if tuple(maps.shape[-2:]) == tuple(size):
        return maps
    if all(there <= here for there, here in zip(size, maps.shape[-2:])):
        return functional.adaptive_avg_pool2d(maps, tuple(size))  # no place is left out
    return functional.interpolate(maps, size=tuple(size), mode="bilinear", align_corners=False)
