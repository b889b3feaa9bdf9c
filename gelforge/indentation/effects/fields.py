"""Stiffness of every element: factors of layers, particles, age, temperature, and what is soft or hard in places.

Places are those of the sensor as drawn. An element that an edge cuts takes part by its share of volume (a ball's by
what that share does to all around it), so that nothing jumps as an edge moves.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from gelforge.config import ConfigError, Effects, Mechanics, Sensor
from gelforge.config.parts.effects import Circumstances, Delamination, Patch, WallSide
from gelforge.indentation.effects.material import by_region, region_bulk
from gelforge.mechanics.meshes.elements import ELEMENTS
from gelforge.mechanics.meshes.mesh import Mesh

# Share of its stiffness that what is wholly lost keeps, so that every node is held: a strip does 0.9985 of what one that is
# cut out does (tests/indentation/test_effects_limits.py).
LEAST = 1e-3
CONSTRAINT = 0.4  # Eshelby's 6 (K + 2 G) / (5 (3 K + 4 G)) of a ball, K >> G
RIGID, LOST = 1 / CONSTRAINT, -1 / (1 - CONSTRAINT)
# Sample points along an element's side: the volume of a ball of radius 1.2 elements is right to 2 %
# (tests/indentation/test_element_stiffness.py).
PARTS = 6


def element_stiffness(
    mesh: Mesh, sensor: Sensor, mechanics: Mechanics
) -> tuple[np.ndarray | None, np.ndarray | None]:
    """Return the factors on the elements' moduli, shear and bulk.

    Parameters
    ----------
    mesh : Mesh
        E elements of the sensor as drawn.
    sensor : Sensor
        Its layers.
    mechanics : Mechanics
        Its effects of material and geometry.

    Returns
    -------
    numpy.ndarray or None
        (E,) on the shear modulus [-]; None where no effect changes a modulus.
    numpy.ndarray or None
        (E,) on the bulk modulus [-]; None with the first.
    """
    effects = mechanics.effects
    material, geometry = effects.material, effects.geometry
    top = sensor.layers[-1].name
    factor = np.ones(len(mesh.elements))
    for values in (material.stiffness_factor, circumstance_factors(material.circumstances)):
        if values:
            factor *= np.array(list(by_region(values, mesh.regions, top, 1.0).values()))[mesh.region]
    if material.particles.stiffening or material.particles.settling:
        factor *= _particle_factor(mesh, sensor, effects)
    if geometry.toe.factor != 1:
        # Parts stacked along z are loaded in series: their compliances add.
        factor *= 1 / (1 + _overlap(mesh, 2, -geometry.toe.thickness_mm, 0.0) * (1 / geometry.toe.factor - 1))
    for patch in geometry.patches:
        factor *= 1 + _box_share(mesh, sensor, patch) * (patch.factor - 1)
    shear, bulk = factor, factor
    ratio = np.array(list(region_bulk(sensor, mechanics, mesh.regions).values()))[mesh.region]
    gaps = [geometry.wall_gap.loss * _wall_strip(mesh, sensor, effects)] if geometry.wall_gap.loss else []
    for lost in gaps + [_lost_beside(mesh, sensor, one) for one in geometry.wall_sides]:
        # a gap closes without resistance: of K no more is left than of G
        shear, bulk = shear * (1 - lost * (1 - LEAST)), bulk * (1 - lost * (1 - LEAST / ratio))
    for inclusion in geometry.inclusions:
        share = _share_within(mesh, np.array(inclusion.centre_mm), inclusion.radius_mm)
        shear = shear * mixed_factor(inclusion.factor, share)
        bulk_factor = inclusion.factor if inclusion.bulk_factor is None else inclusion.bulk_factor
        bulk = bulk * bulk_factor_of(share * volume_field(bulk_factor, ratio), ratio)
    for film in geometry.delaminations:
        shear = shear * (1 - film.loss * (1 - LEAST) * _film_share(mesh, sensor, film))
    if (shear == 1).all() and (bulk == 1).all():
        return None, None
    return shear, bulk


def eshelby_factor(phi):
    """Return the stiffness over that of the matrix at the volume share phi of rigid balls, 1 / (1 - 5 phi / 2).

    Eshelby 1957 (doi 10.1098/rspa.1957.0133): a dilute share of rigid balls in an incompressible matrix takes 5/2 phi off
    its compliance; to first order Smallwood's 1 + 5/2 phi (1944, doi 10.1063/1.1707385).
    """
    return 1 / (1 - 2.5 * phi)


def far_field(factor):
    """Return what a ball `factor` times as stiff as an incompressible matrix does to all around it, per volume.

    Its growth of stiffness over the growth of its strain's constraint (Eshelby 1957): LOST for an empty ball, RIGID for a
    rigid one, and no more however stiff.
    """
    return (factor - 1) / (1 + CONSTRAINT * (factor - 1))


def factor_of(field):
    """Return the factor of which `far_field` is the given one."""
    return 1 + field / (1 - CONSTRAINT * field)


def volume_field(factor, ratio):
    """Return how far a ball whose bulk modulus is `factor` times that of the matrix gives way to pressure, per volume.

    Its loss of bulk modulus over that modulus and the 4/3 G with which the matrix holds it (Eshelby 1957); ratio: K / G.
    """
    return (1 - factor) / (factor + 4 / (3 * ratio))


def bulk_factor_of(field, ratio):
    """Return the factor of which `volume_field` is the given one."""
    return (1 - 4 / (3 * ratio) * field) / (1 + field)


def mixed_factor(factor, share):
    """Return the shear stiffness over that of the matrix of an element of which a share is `factor` times as stiff.

    A part does to all around what it would do as a ball (Mori & Tanaka 1973, doi 10.1016/0001-6160(73)90064-3). The mean of
    the moduli, which parts reach only where all strain alike, makes what is hard several times too strong.
    """
    return factor_of(share * far_field(factor))


def circumstance_factors(c: Circumstances) -> dict[str, float]:
    """Return the factor of each region that ages or feels the temperature."""
    days, kelvin = c.age_days - c.reference_age_days, c.temperature_C - c.reference_temperature_C
    named = {*c.ageing_per_day, *c.stiffening_per_K}
    factors = {
        name: (1 + c.ageing_per_day.get(name, 0.0) * days) * (1 + c.stiffening_per_K.get(name, 0.0) * kelvin)
        for name in sorted(named)
    }
    for name, factor in factors.items():
        if not factor > 0:
            raise ConfigError(
                f"age and temperature give {name} a stiffness factor of {factor:g}; > 0 is needed"
            )
    return factors


def _particle_factor(mesh: Mesh, sensor: Sensor, effects: Effects) -> np.ndarray:
    """Return the factor (E,) of tracer particles, evenly spread or partly sunk."""
    particles, z = effects.material.particles, mesh.X[mesh.elements, 2].mean(axis=1)
    phi, bottom = np.zeros(len(mesh.elements)), -sensor.height_mm
    for number, layer in enumerate(sensor.layers):
        depth = 1 - 2 * (z - bottom) / layer.thickness_mm  # 1 at the layer's bottom, -1 at its top
        local = layer.particle_volume_fraction * (particles.stiffening + particles.settling * depth)
        phi += local * (mesh.region == number)
        bottom += layer.thickness_mm
    return eshelby_factor(phi)


def _samples(nodes: int) -> np.ndarray:
    """Return the shape functions (P, A) of an element of A nodes at points evenly spread in it."""
    line = (np.arange(PARTS) + 0.5) / PARTS
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    return ELEMENTS[nodes].shape(2 * grid - 1 if nodes == 8 else grid[grid.sum(axis=1) < 1])


def _overlap(mesh: Mesh, axis: int, low: float, high: float) -> np.ndarray:
    """Return the share (E,) of each element's extent along an axis that lies within low and high [mm]."""
    x = mesh.X[mesh.elements, axis]
    first, last = x.min(axis=1), x.max(axis=1)
    return np.clip(np.minimum(last, high) - np.maximum(first, low), 0, None) / (last - first)


def _wall_strip(mesh: Mesh, sensor: Sensor, effects: Effects) -> np.ndarray:
    """Return the share (E,) of the lower layers' elements within the strip along the wall."""
    edge = sensor.wall_mm + effects.geometry.wall_gap.width_mm
    inner = _overlap(mesh, 0, edge, sensor.width_x_mm - edge)
    inner = inner * _overlap(mesh, 1, edge, sensor.width_y_mm - edge)
    return (1 - inner) * (mesh.region < len(sensor.layers) - 1)


def _lost_beside(mesh: Mesh, sensor: Sensor, weak: WallSide) -> np.ndarray:
    """Return the lost share (E,) of the wall's elements along one side, and of the lower layers' within the strip there."""
    axis, end = "xy".index(weak.side[0]), weak.side[2:]
    width = (sensor.width_x_mm, sensor.width_y_mm)[axis]
    edges = np.array([0.0, sensor.wall_mm, sensor.wall_mm + weak.width_mm])
    outer, inner, beyond = edges if end == "low" else width - edges
    wall, strip = (_overlap(mesh, axis, *sorted(pair)) for pair in ((outer, inner), (inner, beyond)))
    in_wall = mesh.region == mesh.regions.index("wall")
    below_skin = mesh.region < len(sensor.layers) - 1
    return weak.wall_loss * wall * in_wall + weak.bond_loss * strip * below_skin


def _share_within(mesh: Mesh, centre: np.ndarray, radius: float) -> np.ndarray:
    """Return the share (E,) of each element within a radius of a centre (2,) or (3,) [mm], in a plane or in space.

    Its edge is as wide as the samples lie apart.
    """
    return _shares(mesh.X, mesh.elements, _samples(mesh.elements.shape[1]), centre, float(radius))


@nb.njit(cache=True)
def _shares(X, elements, shape, centre, radius):
    """Return the mean (E,) over samples, shape (P, A), of how far within the radius they are, cut off at their distance."""
    (E, A), P, axes = elements.shape, len(shape), len(centre)
    share = np.zeros(E)
    for e in range(E):
        apart, outside = 0.0, 0.0
        for i in range(3):
            low = high = X[elements[e, 0], i]
            for a in range(1, A):
                low, high = min(low, X[elements[e, a], i]), max(high, X[elements[e, a], i])
            apart = max(apart, (high - low) / PARTS)
            if i < axes:
                outside += max(low - centre[i], centre[i] - high, 0.0) ** 2
        if np.sqrt(outside) >= radius + apart:
            continue
        for p in range(P):
            square = 0.0
            for i in range(axes):
                place = 0.0
                for a in range(A):
                    place += shape[p, a] * X[elements[e, a], i]
                square += (place - centre[i]) ** 2
            share[e] += min(max((radius - np.sqrt(square)) / apart + 0.5, 0.0), 1.0)
        share[e] /= P
    return share


def _box_share(mesh: Mesh, sensor: Sensor, patch: Patch) -> np.ndarray:
    """Return the share (E,) of each element of a layer inside the box; boxes that fill the body add up to 1."""
    along = [_overlap(mesh, axis, patch.low_mm[axis], patch.high_mm[axis]) for axis in range(3)]
    return np.prod(along, axis=0) * (mesh.region < len(sensor.layers))


def _film_share(mesh: Mesh, sensor: Sensor, patch: Delamination) -> np.ndarray:
    """Return the share (E,) of each element inside the loose film."""
    names = [layer.name for layer in sensor.layers]
    number = names.index(patch.layer)
    bottom = sum(layer.thickness_mm for layer in sensor.layers[:number]) - sensor.height_mm
    top = bottom + sensor.layers[number].thickness_mm
    low, high = (top - patch.film_mm, top) if patch.face == "top" else (bottom, bottom + patch.film_mm)
    disc = _share_within(mesh, np.array(patch.centre_mm), patch.radius_mm)
    return disc * _overlap(mesh, 2, low, high) * (mesh.region == number)
