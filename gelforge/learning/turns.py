"""Turns and mirror images of grids that carry vectors: how an image lies on the sensor, and more data from a symmetry."""

from __future__ import annotations

import numpy as np
import torch

from gelforge.indentation.symmetry import D4

LEAST_FOLLOWED = (
    0.5  # share of the places' variance that the flow's centre explains; less says nothing of directions
)
OFF_CENTRE = 0.03  # of the sensor's width: farther off its middle the camera sees another picture mirrored
UNEVEN = 0.05  # difference of its scales along two axes


def order(name: str, nx: int, ny: int) -> np.ndarray:
    """Return for each place k = nx iy + ix of a turned grid the place (nx ny,) that its value comes from."""
    index = np.arange(nx * ny)
    middle = np.array([nx - 1, ny - 1]) / 2
    target = np.rint((np.stack([index % nx, index // nx], axis=-1) - middle) @ D4[name].T + middle).astype(
        int
    )
    source = np.empty(nx * ny, int)
    source[target[:, 1] * nx + target[:, 0]] = index
    return source


def names_of(square: bool) -> tuple[str, ...]:
    """Return the elements of D4 that carry a square, or a rectangle, onto itself."""
    return tuple(name for name in D4 if square or D4[name][0, 1] == 0)


def turned_flow(name: str, flow: np.ndarray, n: int) -> np.ndarray:
    """Return flow (N, 2, n n) carried by an element of D4: its places and its components."""
    return np.einsum("ab,Nbk->Nak", D4[name].astype(flow.dtype), flow[:, :, order(name, n, n)])


def image_on_sensor(centre: np.ndarray, position: np.ndarray, width_mm: np.ndarray) -> tuple[str, bool]:
    """Return the element of D4 that carries the image onto the sensor, and whether the camera looks along its axis.

    centre (N, 2): where the flow of an image is, as shares of the image's width and height from its middle (u right, v
    down); position (N, 2) [mm]: where the indenter was. An image is taken as it is where the one does not follow the other.
    """
    share = (position - width_mm / 2) / width_mm
    design = np.column_stack([centre, np.ones(len(centre))])
    found, _, rank, _ = np.linalg.lstsq(design, share, rcond=None)
    spread = share.var(axis=0).sum()
    left = (share - design @ found).var(axis=0).sum()
    if rank < 3 or not spread or left > (1 - LEAST_FOLLOWED) * spread:
        return "identity", False
    linear, offset = found[:2].T, found[2]  # share = linear @ centre + offset
    name = max(D4, key=lambda element: float(np.sum(D4[element] * linear)))
    scale = np.sum(D4[name] * linear) / 2
    uneven = np.abs(linear - scale * D4[name]).max() / scale
    return name, bool(np.abs(offset).max() < OFF_CENTRE and uneven < UNEVEN)


def flow_centre(flow: np.ndarray, n: int) -> np.ndarray:
    """Return where the flow (N, 2, n n) is (N, 2): its squared length's centre, as shares of the image from its middle."""
    weight = (flow**2).sum(axis=1)
    index = np.arange(n * n)
    place = (np.stack([index % n, index // n], axis=-1) + 0.5) / n - 0.5
    return weight @ place / np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)


class Turner:
    """Turns scaled inputs (n, 2 r^2) and targets (n, 3 B) of a batch together; scales must be those of a symmetry."""

    def __init__(self, names: tuple[str, ...], regions: int, nx: int, ny: int):
        self.names = names
        self._regions = {name: torch.from_numpy(order(name, regions, regions)) for name in names}
        self._bins = {name: torch.from_numpy(order(name, nx, ny)) for name in names}
        self._plane = {name: torch.tensor(D4[name], dtype=torch.float32) for name in names}

    def __call__(
        self, name: str, inputs: torch.Tensor, targets: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        plane = self._plane[name]
        flow = inputs.reshape(len(inputs), 2, -1)[:, :, self._regions[name]]
        force = targets.reshape(len(targets), -1, 3)[:, self._bins[name]]
        flow = torch.einsum("ab,nbk->nak", plane, flow)
        force = torch.cat([force[..., :2] @ plane.T, force[..., 2:]], dim=-1)
        return flow.reshape(inputs.shape), force.reshape(targets.shape)
