"""One linear map from all regions to all bins."""

from torch import nn

from gelforge.learning.basis.network import Network, OnGrids, seeded

KEYS = ("symmetry",)
USUAL = {"learning_rate": 1e-3, "batch_size": 32, "steps": 2000}


class Linear(OnGrids):
    """Every bin sees every region."""

    def __init__(self, grids, channels):
        super().__init__(grids)
        self.whole = nn.Linear(2 * grids.regions**2, 3 * grids.bins_x * grids.bins_y)

    def on_grids(self, maps):
        return self.whole(maps.flatten(1)).reshape(-1, 3, self.grids.bins_y, self.grids.bins_x)


NETWORK = Network("linear", seeded(Linear))
