"""Turns and mirror images of grids that carry vectors: how an image lies on the sensor, and more data from a symmetry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gelforge.config import Camera, Sensor
from gelforge.indentation.sensor.symmetry import D4
from gelforge.recording.optics.camera import project

if TYPE_CHECKING:
    import torch

# How an image lies on the sensor is found, or said not to be known (tests/learning/test_turns.py):
LEAST_FOLLOWED = (
    0.5  # share of the places' variance that the flow's centre explains; less says nothing of directions
)
# Of the sensor's width: farther off its middle the camera sees another picture mirrored. Cameras 2 mm aside of 32 mm or
# turned by 3 degrees are found, noise of 0.002 passes (tests/learning/test_turns.py).
OFF_CENTRE = 0.03
# Difference of its scales along two axes: scales that differ by a fifth are found, noise of 0.002 of the width passes
# (tests/learning/test_turns.py).
UNEVEN = 0.05


def order(name: str, nx: int, ny: int) -> np.ndarray:
    """Return for each place k = nx iy + ix of a turned grid the place (nx ny,) that its value comes from."""
    index = np.arange(nx * ny)
    middle = np.array([nx - 1, ny - 1]) / 2
    place = np.stack([index % nx, index // nx], axis=-1) - middle
    target = np.rint(place @ D4[name].T + middle).astype(int)
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
    affine, _, rank, _ = np.linalg.lstsq(design, share, rcond=None)
    spread = share.var(axis=0).sum()
    left = (share - design @ affine).var(axis=0).sum()
    if rank < 3 or not spread or left > (1 - LEAST_FOLLOWED) * spread:
        return "identity", False
    linear, offset = affine[:2].T, affine[2]  # share = linear @ centre + offset
    name = max(D4, key=lambda element: float(np.sum(D4[element] * linear)))
    scale = np.sum(D4[name] * linear) / 2
    uneven = np.abs(linear - scale * D4[name]).max() / scale
    return name, bool(np.abs(offset).max() < OFF_CENTRE and uneven < UNEVEN)


def seen_by_camera(camera: Camera, sensor: Sensor) -> tuple[str, bool]:
    """Return the same as image_on_sensor for a known camera: by where it sees points at half the sensor's height."""
    width = np.array([sensor.width_x_mm, sensor.width_y_mm])
    shares = np.linspace(0.1, 0.9, 5)
    points = np.stack(np.meshgrid(*(shares * w for w in width)), axis=-1).reshape(-1, 2)
    pixels, _ = project(camera, np.column_stack([points, np.full(len(points), -sensor.height_mm / 2)]))
    centre = (pixels + 0.5) / [camera.width_px, camera.height_px] - 0.5
    return image_on_sensor(centre, points, width)


def flow_centre(flow: np.ndarray, n: int) -> np.ndarray:
    """Return where the flow (N, 2, n n) is (N, 2): its squared length's centre, as shares of the image from its middle."""
    weight = (flow**2).sum(axis=1)
    index = np.arange(n * n)
    place = (np.stack([index % n, index // n], axis=-1) + 0.5) / n - 0.5
    return weight @ place / np.maximum(weight.sum(axis=1, keepdims=True), 1e-30)


class Turner:
    """Turns each row of scaled inputs (n, 2 r^2) and targets (n, 3 B) by an element of its own.

    Inputs may end with forces of the bins (3 B). Scales must be those of a symmetry.
    """

    def __init__(self, names: tuple[str, ...], regions: int, nx: int, ny: int):
        import torch  # here: an exported model answers without it

        self.names = names
        orders = [[order(name, *grid) for name in names] for grid in ((regions, regions), (nx, ny))]
        self._regions, self._bins = (torch.from_numpy(np.stack(one)) for one in orders)  # (T, r^2), (T, B)
        self._plane = torch.tensor(np.stack([D4[name] for name in names]), dtype=torch.float32)  # (T, 2, 2)

    def __call__(
        self, chosen: np.ndarray, inputs: torch.Tensor, targets: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return inputs and targets whose row i is turned by the element names[chosen[i]]; chosen (n,) int."""
        import torch

        count, which = len(inputs), torch.as_tensor(chosen)
        plane, regions, bins = self._plane[which], self._regions[which], self._bins[which]

        def turned(force: torch.Tensor) -> torch.Tensor:
            moved = force.reshape(count, -1, 3).gather(1, bins[..., None].expand(-1, -1, 3))
            horizontal = torch.einsum("nab,nkb->nka", plane, moved[..., :2])
            return torch.cat([horizontal, moved[..., 2:]], dim=-1).reshape(force.shape)

        size = 2 * regions.shape[1]
        flow = inputs[:, :size].reshape(count, 2, -1).gather(2, regions[:, None].expand(-1, 2, -1))
        flow = torch.einsum("nab,nbk->nak", plane, flow).reshape(count, size)
        more = inputs[:, size:]
        return torch.cat([flow, turned(more)], dim=1) if more.shape[1] else flow, turned(targets)
