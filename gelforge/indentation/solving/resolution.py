"""How finely a mesh resolves the gel, a stiff layer and the walls around a site."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gelforge.config import Mesh, Sensor
from gelforge.indentation.sensor.sensor_mesh import by_hexahedra, elements_through, sizes_of
from gelforge.mechanics.laws.law import PrincipalLaw

# Of the distance from a wall over the sensor's height; `python benchmarks/stiff_layers.py --fit` prints the likelihood of
# others.
DECAY = 2.0


@dataclass(frozen=True)
class Resolution:
    """What the error of a total depends on, next to the size of the elements in contact."""

    through: float  # elements between contact and base
    # 1 - softest over stiffest layer's shear modulus; 0 for tetrahedra, which bend right
    contrast: float = 0.0
    walls: float = 0.0  # sum over the walls of exp(-DECAY distance / height) over the square of elements through the wall


def resolution_of(
    sensor: Sensor, mesh: Mesh, laws: Mapping[str, PrincipalLaw], x_mm: float, y_mm: float
) -> Resolution:
    """Return the resolution of a site.

    Parameters
    ----------
    sensor : Sensor
        Block or other shape.
    mesh : Mesh
        Element sizes [mm].
    laws : mapping of str to PrincipalLaw
        By material [MPa].
    x_mm, y_mm : float
        The site in the sensor frame.

    Returns
    -------
    Resolution
        Of this site.
    """
    through = elements_through(sensor, mesh)
    if not by_hexahedra(sensor, mesh):
        return Resolution(through)
    moduli = [laws[layer.material].shear_modulus for layer in sensor.layers]
    contrast = 1 - min(moduli) / max(moduli)
    if not sensor.wall_mm or len(sensor.layers) == 1:  # without a second layer the wall is gel
        return Resolution(through, contrast)
    inside = np.array([x_mm, y_mm, sensor.width_x_mm - x_mm, sensor.width_y_mm - y_mm]) - sensor.wall_mm
    near = np.exp(-DECAY * np.maximum(inside, 0) / sensor.height_mm).sum()
    return Resolution(through, contrast, near / sizes_of(mesh).through_wall(sensor.wall_mm) ** 2)
