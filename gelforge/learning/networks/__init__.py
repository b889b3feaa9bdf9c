"""The networks: every file of this folder is one, defines `NETWORK` and states KEYS and USUAL, which configurations read."""

from __future__ import annotations

from torch import nn

from gelforge.config import Learning
from gelforge.learning.basis.network import Grids, Network
from gelforge.registry import defined


def network_of(name: str) -> Network:
    """Return a network by its name. Raises TypeError or ValueError for a file that defines no NETWORK of its own name."""
    return defined(__name__, name, "NETWORK", Network)


def make_network(learning: Learning, grids: Grids, seed: int) -> nn.Module:
    """Return the network that learning.network names, seeded."""
    return network_of(learning.network).make(learning, grids, seed)
