"""The error bar of every label: discretisation from a coarse-mesh solution, material from the covariance of the laws.

Both are standard deviations per force component, of bins and of the total. Those of a depth depend on that depth alone, as
far as the coarse-mesh solution got: the same indentation on a mesh with all sizes doubled. What it differs by is no error
bar yet: near the contact's rim the difference of a bin changes sign from place to place. Its mean square over a bin and its
neighbours does not, and the true error is a stable part of its root, with a small share of the bin's own force.

In a total the errors of near and far size can cancel, at other depths than in the coarse-mesh solution's difference. Next to
a part of that difference stand a part of the bins' bars and two shares of the force. One is what few nodes in contact cannot
resolve: an error in proportion to the square of element size over contact radius, hence to one over their number. The other
is what few elements between contact and base cannot: an incompressible gel is squeezed aside in a parabola over its height,
and linear elements miss a parabola by the square of size over height, hence by one over the square of their number.

Linear hexahedra also bend too stiffly, by the square of size over height, which raises the force where one layer is stiffer
than another. At the default sizes other errors cancel most of it, so that it falls with about the fifth power of their
number. Walls that bend add a share that falls with the distance from them. benchmarks/stiff_layers.py found both parts on
some places and checks them on others, benchmarks/error_bars.py the other parts (docs/accuracy.md).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from gelforge.indentation.solving.resolution import Resolution
from gelforge.mechanics.laws.law import PrincipalLaw

# Parts found and checked by `python benchmarks/error_bars.py`:
COARSER = 2.0  # the coarse-mesh solution's sizes over the site's
# standard deviation of the weights of the mean square, of bins along x and y (benchmarks/error_bars.py)
SMOOTHING = 0.6
PART_BINS = np.array([0.30, 0.30, 0.34])  # x, y, z: of the root mean square difference of bins
SHARE_BINS = 0.007  # of the force of the bin itself (benchmarks/error_bars.py)
# of the largest bin: bins that carry next to nothing have an error too (benchmarks/error_bars.py)
LEAST_BINS = 5e-4
PART_TOTALS = np.array([0.12, 0.12, 0.05])  # x, y, z: of the difference of totals
# Of a total, over the square of the number of elements through the sensor: of largest likelihood on seven places of
# calibration (docs/accuracy.md).
SHARE_LAYERS = 0.15
# Of a total, over the fifth power of that number, times Resolution.contrast (`python benchmarks/stiff_layers.py --fit`).
# The sixth power is likelier by 4 in the logarithm, and says more than is found where elements are few (judgement).
SHARE_STIFF = 140.0
# At most so much over the square of that number, as bending errs: the two meet at 4.5 elements, and with fewer the fifth
# power says more than `python benchmarks/stiff_layers.py` finds (judgement).
SHARE_BENDING = 1.5
# x, y, z: of the vertical total, times contrast and Resolution.walls. Along z 0.03 is likeliest with the fifth power, 0.06
# with the sixth: the larger is kept (benchmarks/stiff_layers.py --fit).
SHARE_WALLS = np.array([0.04, 0.04, 0.06])
# Of a total, over the number of nodes in contact: the error of first touch (docs/accuracy.md).
SHARE_TOUCH = 0.15
# of the bins' bars as if independent, on the total: what the near size errs by does not cancel in them
# (benchmarks/error_bars.py)
PART_OF_BINS = 0.2
# of the vertical difference, on horizontal totals: near a wall they lean on it (benchmarks/error_bars.py)
CROSS_TOTALS = 0.02
# Of a standard deviation, by which a law is moved: its effect is then a straight line to 2 %
# (tests/indentation/test_error_bars.py).
AMOUNT = 0.05


@dataclass(frozen=True)
class Companion:
    """What the coarser solution says of the same depths: forces, and how they follow the laws' uncertain directions."""

    total: np.ndarray  # (D, 3) [N]
    bins: np.ndarray  # (D, B, 3) [N]
    # (n, D, 3) [N per standard deviation], one per independent direction of the laws' parameters
    total_slopes: np.ndarray
    bin_slopes: np.ndarray  # (n, D, B, 3)

    def first(self, depths: int) -> Companion:
        """Return what it says of so many depths."""
        slopes = self.total_slopes[:, :depths], self.bin_slopes[:, :depths]
        return Companion(self.total[:depths], self.bins[:depths], *slopes)


def error_bars(
    total: np.ndarray,
    bins: np.ndarray,
    touched: np.ndarray,
    shape: tuple[int, int],
    companion: Companion,
    resolution: Resolution,
) -> dict[str, np.ndarray]:
    """Return the error bars of a site's totals and bins: standard deviations by mesh and by material.

    Depths that the coarse-mesh solution did not reach take its last depth's bars, grown with the force.

    Parameters
    ----------
    total : numpy.ndarray
        (D, 3) [N].
    bins : numpy.ndarray
        (D, B, 3) [N].
    touched : numpy.ndarray
        (D,) nodes in contact.
    shape : (int, int)
        ny and nx of the grid of bins.
    companion : Companion
        The coarse-mesh solution.
    resolution : Resolution
        How finely the mesh resolves gel, stiff layers and walls there.

    Returns
    -------
    dict of str to numpy.ndarray
        total_sigma_mesh_N and total_sigma_material_N (D, 3), bin_sigma_mesh_N and bin_sigma_material_N (D, B, 3), in
        N. Where the coarse mesh reached no depth they are as large as the forces.
    """
    reached = len(companion.total)
    if reached == 0:
        size = {"bin": np.abs(bins), "total": np.abs(total)}  # nothing is known: as large as the force
        names = [f"{quantity}_sigma_{part}_N" for quantity in size for part in ("mesh", "material")]
        return {name: size[name.partition("_")[0]] for name in names}
    mesh_bins = _mesh_bins(bins[:reached], companion.bins, shape)
    uncancelled = PART_OF_BINS * np.sqrt((mesh_bins**2).sum(axis=1))
    bars = {
        "bin_sigma_mesh_N": mesh_bins,
        "total_sigma_mesh_N": np.sqrt(
            mesh_totals(total[:reached], companion.total) ** 2
            + uncancelled**2
            + touch_totals(total[:reached], touched[:reached]) ** 2
            + layer_totals(total[:reached], resolution) ** 2
        ),
        "bin_sigma_material_N": np.sqrt((companion.bin_slopes**2).sum(axis=0)),
        "total_sigma_material_N": np.sqrt((companion.total_slopes**2).sum(axis=0)),
    }
    if reached == len(total):
        return bars
    size = np.linalg.norm(total, axis=1)
    growth = size[reached:] / size[reached - 1] if size[reached - 1] > 0 else np.ones(len(total) - reached)
    return {
        name: np.concatenate([values, growth.reshape(-1, *[1] * (values.ndim - 1)) * values[-1]])
        for name, values in bars.items()
    }


def _mesh_bins(bins: np.ndarray, coarse: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the discretisation error bars (D, B, 3) [N] of bins from those of the coarse-mesh solution."""
    square = ((bins - coarse) ** 2).reshape(len(bins), *shape, 3)
    borders = ("nearest", "constant", "constant", "nearest")  # no force beyond the surface
    mean = gaussian_filter(square, (0, SMOOTHING, SMOOTHING, 0), mode=borders).reshape(bins.shape)
    sigma = PART_BINS * np.sqrt(np.maximum(mean, 0.0))
    size = np.linalg.norm(bins, axis=-1, keepdims=True)
    loaded = (size > 0) | (np.abs(coarse).max(axis=-1, keepdims=True) > 0)
    least = LEAST_BINS * np.abs(bins).max(axis=(1, 2), keepdims=True) * loaded
    return np.sqrt(sigma**2 + (SHARE_BINS * size) ** 2 + least**2)


def mesh_totals(total: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    """Return the discretisation error bars (D, 3) [N] of totals by their difference from the coarse mesh."""
    x, y, z = ((total - coarse) ** 2).T
    horizontal, crossed = (x + y) / 2, CROSS_TOTALS**2 * z
    own, others = np.array([horizontal, horizontal, z]).T, np.array([crossed, crossed, 0 * z]).T
    return np.sqrt(PART_TOTALS**2 * own + others)


def touch_totals(total: np.ndarray, touched: np.ndarray) -> np.ndarray:
    """Return the error bars (D, 3) [N] of totals by the number of nodes in contact (D,)."""
    return SHARE_TOUCH / np.maximum(touched, 1)[:, None] * np.abs(total)


def layer_totals(total: np.ndarray, resolution: Resolution) -> np.ndarray:
    """Return the error bars (D, 3) [N] of totals by the elements through the gel, stiff layers and walls."""
    n = resolution.through
    stiff = min(SHARE_STIFF / n**5, SHARE_BENDING / n**2) * resolution.contrast
    through = np.hypot(SHARE_LAYERS / n**2, stiff) * np.abs(total)
    walls = SHARE_WALLS * resolution.contrast * resolution.walls * np.abs(total[:, 2:])
    return np.hypot(through, walls)


def laws_moved(
    uncertain: Mapping[str, Sequence[PrincipalLaw]],
    laws: Mapping[str, PrincipalLaw],
    materials: Mapping[str, str],
) -> list[dict[str, PrincipalLaw]]:
    """Return per uncertain direction the laws by layer with one material's law moved.

    uncertain: by material, its law moved by AMOUNT of a standard deviation along each independent direction; laws by layer;
    materials: the material of each layer.
    """
    return [
        {layer: law if materials[layer] == material else given for layer, given in laws.items()}
        for material in sorted(set(materials.values()))
        for law in uncertain.get(material, ())
    ]
