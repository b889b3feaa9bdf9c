"""Tracer particles or printed dots in the undeformed gel, and where a simulated indentation moves them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

from gelforge.config import PrintedDots, Sensor, VirtualParticles
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import transform_points, transform_vectors

# Coordinates this close are one: site files may hold float32, and no element is that thin. float32 holds 30 mm to 2e-6
# mm (IEEE 754-2008).
SAME_MM = 1e-4


class VirtualLabError(ValueError):
    """A virtual recording that cannot be made: why, what to do."""


def serial_seed(serial: str) -> int:
    """Return the seed that a sensor's serial stands for."""
    return int.from_bytes(hashlib.sha256(serial.encode()).digest()[:8], "little")


def gel_boxes(sensor: Sensor) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the boxes of the layers that the camera sees move; the wall surrounds every layer but the top one.

    Parameters
    ----------
    sensor : Sensor
        A block.

    Returns
    -------
    list of (numpy.ndarray, numpy.ndarray)
        Lowest and highest corner (3,) [mm] of each layer, from the base up.
    """
    boxes, base = [], -sensor.height_mm
    for number, layer in enumerate(sensor.layers):
        wall = sensor.wall_mm if number < len(sensor.layers) - 1 else 0.0
        low = np.array([wall, wall, base])
        high = np.array([sensor.width_x_mm - wall, sensor.width_y_mm - wall, base + layer.thickness_mm])
        if layer in sensor.imaged_layers:
            boxes.append((low, high))
        base += layer.thickness_mm
    return boxes


def dots_box(dots: PrintedDots, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Return the box of the layer in which dots are printed; on a border between two, of the upper one.

    Parameters
    ----------
    dots : PrintedDots
        Their depth [mm] below the top surface.
    sensor : Sensor
        A block.

    Returns
    -------
    (numpy.ndarray, numpy.ndarray)
        Lowest and highest corner (3,) [mm].

    Raises
    ------
    VirtualLabError
        For dots in none of the layers that the camera sees.
    """
    for low, high in reversed(gel_boxes(sensor)):
        if low[2] <= -dots.depth_mm <= high[2]:
            return low, high
    names = ", ".join(layer.name for layer in sensor.imaged_layers)
    raise VirtualLabError(
        f"dots {dots.depth_mm:g} mm deep lie in none of the layers that the camera sees ({names}); correct "
        "particles.dots.depth_mm, or the layers' particle_volume_fraction"
    )


def mean_height(particles: VirtualParticles, sensor: Sensor) -> float:
    """Return the mean height of what the camera sees move: of dots, of layers with particles.

    Parameters
    ----------
    particles : VirtualParticles
        Dots or particles of the virtual sensor.
    sensor : Sensor
        Its layers.

    Returns
    -------
    float
        z [mm]; negative is below the top surface.
    """
    if particles.dots:
        return -particles.dots.depth_mm
    return float(np.mean([(low[2] + high[2]) / 2 for low, high in gel_boxes(sensor)]))


def place_particles(particles: VirtualParticles, sensor: Sensor, serial: str) -> np.ndarray:
    """Return the centres of particles or printed dots.

    Particles lie wholly inside the gel and do not overlap (random sequential addition). Dots lie on a square grid, shifted
    and turned as drawn.

    Parameters
    ----------
    particles : VirtualParticles
        Diameter [mm] and volume fraction, or dots.
    sensor : Sensor
        Layers with their volume fraction of particles.
    serial : str
        Of the sensor; it seeds the draw.

    Returns
    -------
    numpy.ndarray
        (P, 3) [mm] in the sensor frame.

    Raises
    ------
    VirtualLabError
        For a sensor without particles and dots, a layer thinner than a particle, and dots closer than their diameter.
    """
    rng = np.random.default_rng(serial_seed(serial))
    if particles.dots:
        return _printed(particles.dots, particles.diameter_mm, sensor, rng)
    if not any(layer.particle_volume_fraction for layer in sensor.layers):
        raise VirtualLabError(
            "no layer has particle_volume_fraction > 0; the virtual camera would see nothing; give a layer particles, or "
            "particles.dots"
        )
    return np.concatenate([_fill(low, high, particles, rng) for low, high in gel_boxes(sensor)])


def _printed(dots: PrintedDots, diameter: float, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    if dots.spacing_mm <= diameter:
        raise VirtualLabError(
            f"dots {diameter:g} mm wide every {dots.spacing_mm:g} mm overlap; make spacing_mm larger or diameter_mm smaller"
        )
    low, high = (corner[:2] for corner in dots_box(dots, sensor))
    # more than along the diagonal: some fall outside
    count = int(np.hypot(*(high - low)) / dots.spacing_mm) + 2
    line = (np.arange(count) - (count - 1) / 2) * dots.spacing_mm
    grid = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    angle = np.radians(dots.rotation_deg) * rng.standard_normal()
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    middle = np.array([sensor.width_x_mm, sensor.width_y_mm]) / 2
    xy = grid @ turn.T + middle + dots.offset_mm * rng.standard_normal(2)
    inside = ((xy >= low + diameter / 2) & (xy <= high - diameter / 2)).all(axis=1)
    return np.column_stack([xy[inside], np.full(inside.sum(), -dots.depth_mm)])


def _fill(
    low: np.ndarray, high: np.ndarray, particles: VirtualParticles, rng: np.random.Generator
) -> np.ndarray:
    d = particles.diameter_mm
    if np.min(high - low) <= d:
        raise VirtualLabError(
            f"a particle layer of {np.round(high - low, 3)} mm holds no particle of {d} mm; use a smaller "
            "diameter_mm"
        )
    count = round(particles.volume_fraction * np.prod(high - low) / (np.pi / 6 * d**3))
    centres = np.empty((0, 3))
    while len(centres) < count:  # volume_fraction <= 0.1 is far below jamming (0.38): a few rounds
        candidates = rng.uniform(low + d / 2, high - d / 2, size=(count - len(centres), 3))
        if len(centres):
            candidates = candidates[cKDTree(centres).query(candidates)[0] >= d]
        # of two candidates that overlap the later goes
        later = cKDTree(candidates).query_pairs(d, output_type="ndarray").max(axis=1, initial=-1)
        centres = np.concatenate([centres, np.delete(candidates, later[later >= 0], axis=0)])
    return centres


def interpolation(nodes: np.ndarray, hexahedra: np.ndarray, points: np.ndarray) -> csr_array:
    """Return trilinear weights of nodes at points inside axis-aligned hexahedra.

    The elements may have any order and any size and leave holes, but each must be a box along the axes.

    Parameters
    ----------
    nodes : numpy.ndarray
        (G, 3) [mm].
    hexahedra : numpy.ndarray
        (E, 8) int, rows of nodes.
    points : numpy.ndarray
        (P, 3) [mm].

    Returns
    -------
    scipy.sparse.csr_array
        (P, G); each row sums to 1.

    Raises
    ------
    VirtualLabError
        For a mesh of other elements, and for a point in no element.
    """
    nodes = np.asarray(nodes, dtype=float)
    corners = nodes[hexahedra]  # (E, 8, 3)
    low, high = corners.min(axis=1), corners.max(axis=1)
    axes = [_distinct(nodes[:, k], SAME_MM) for k in range(3)]
    first = np.stack([np.searchsorted(a, low[:, k] + SAME_MM) - 1 for k, a in enumerate(axes)], axis=1)
    last = np.stack([np.searchsorted(a, high[:, k] + SAME_MM) - 1 for k, a in enumerate(axes)], axis=1)
    # a box has every corner at the low or the high end of every axis
    boxed = np.minimum(np.abs(corners - low[:, None]), np.abs(corners - high[:, None])).max() <= SAME_MM
    if not boxed:
        raise VirtualLabError(
            "particles need elements that are boxes along the axes; leave out effects that change the virtual mesh"
        )
    element = np.full([len(a) - 1 for a in axes], -1)  # of each interval of the grid of all node coordinates
    for span in np.unique(last - first, axis=0):
        matching = np.flatnonzero((last - first == span).all(axis=1))
        for step in np.ndindex(*span):
            element[tuple((first[matching] + step).T)] = matching
    place = []
    for a, at in zip(axes, np.transpose(points)):  # the last coordinate belongs to the last interval
        interval = np.searchsorted(a, at, side="right") - 1
        place.append(np.where(np.abs(at - a[-1]) <= SAME_MM, len(a) - 2, interval))
    inside = np.all([(p >= 0) & (p < len(a) - 1) for a, p in zip(axes, place)], axis=0)
    containing = np.where(inside, element[tuple(np.where(inside, p, 0) for p in place)], -1)
    if (containing < 0).any():
        raise VirtualLabError(
            f"particle at {np.round(points[containing.argmin()], 4)} mm lies in no element of the gel; "
            "the site was solved with another sensor"
        )
    xi = (points - low[containing]) / (high[containing] - low[containing])  # (P, 3) in [0, 1]
    # (P, 8, 3)
    middle = 0.5 * (high[containing] - low[containing])[:, None]
    at_high = corners[containing] - low[containing][:, None] > middle
    weights = np.where(at_high, xi[:, None], 1 - xi[:, None]).prod(axis=2)  # (P, 8)
    rows = np.repeat(np.arange(len(points)), 8)
    return csr_array(
        (weights.ravel(), (rows, hexahedra[containing].ravel())), shape=(len(points), len(nodes))
    )


def _distinct(values: np.ndarray, tolerance: float) -> np.ndarray:
    """Return sorted values without those that lie within a tolerance of their predecessor."""
    ordered = np.sort(values)
    return ordered[np.concatenate([[True], np.diff(ordered) > tolerance])]


@dataclass(frozen=True)
class Motion:
    """What a true solution says of one position, smooth in depth: depth [mm] -> displacement (P, 3) [mm], force (3,) [N]."""

    displacement: Callable[[float], np.ndarray]
    force: Callable[[float], np.ndarray]
    unload_force: Callable[[float], np.ndarray]  # during unloading from the deepest depth
    deepest_mm: float


@dataclass(frozen=True)
class PathMotion:
    """What a true solution says of a path: displacements (S, P, 3) [mm] and forces (S, 3) [N] at its steps."""

    displacement: np.ndarray
    force: np.ndarray
    depth_mm: np.ndarray  # (S,)
    push: Callable[[float], np.ndarray]  # force towards the gel [N] while loading, by depth

    def deeper(self, step: int, by_mm: float) -> tuple[np.ndarray, np.ndarray]:
        """Return displacement (P, 3) and force (3,) at a step that is deeper than commanded by a little.

        All displacements grow as the depth does and all forces as the push of the loading does: where the indenter slides
        that is Coulomb's law, where it sticks a first approximation.
        """
        depth = self.depth_mm[step]
        if depth <= 0 or self.push(depth) <= 0:
            return self.displacement[step], self.force[step]
        deeper = max(depth + by_mm, 0.0)
        grown = max(float(self.push(deeper)), 0.0) / float(self.push(depth))
        return self.displacement[step] * deeper / depth, self.force[step] * grown


def path_motion(cell: Cell, particles: np.ndarray) -> PathMotion:
    """Return how an indentation along a path moves the particles (P, 3), by its true solution; paths are never mirrored."""
    depth, force = cell.arrays["depth_mm"], cell.arrays["total_force_N"]
    load = np.array([str(phase) for phase in cell.attributes["phases"]]) == "load"
    weights = interpolation(cell.arrays["gel_node_mm"], cell.arrays["gel_hex"], particles)
    moved = np.stack([weights @ one.astype(float) for one in cell.arrays["gel_displacement_mm"]])
    push = PchipInterpolator(np.append(0.0, depth[load]), np.append(0.0, -force[load, 2]))
    return PathMotion(moved, force, depth, push)


def true_motion(cell: Cell, planned: PlannedCell, particles: np.ndarray, width_mm: float) -> Motion:
    """Return how an indentation at a planned site moves the particles (P, 3), from the true solution of it or of its source.

    A mirrored site's mesh and fields are the source's carried by the symmetry; the particles stay where they are.
    Piecewise cubic in depth without overshoot (PCHIP), from zero at depth 0. The unloading path starts at the deepest.
    """
    phases = np.array([str(phase) for phase in cell.attributes["phases"]])
    depth, force = cell.arrays["depth_mm"], cell.arrays["total_force_N"]
    nodes, moved = cell.arrays["gel_node_mm"], cell.arrays["gel_displacement_mm"]
    if planned.symmetry is not None:
        nodes = transform_points(planned.symmetry, nodes, width_mm)
        force, moved = (transform_vectors(planned.symmetry, field) for field in (force, moved))
    load = phases == "load"
    if not load.any() or (np.diff(depth[load]) <= 0).any() or (np.diff(depth[~load]) >= 0).any():
        raise VirtualLabError(
            f"site {cell.attributes.get('cell')}: depths {depth.tolist()} with phases {phases.tolist()}; "
            "loading depths must increase, then unloading depths decrease"
        )
    weights = interpolation(nodes, cell.arrays["gel_hex"], particles)
    at_particles = np.stack([weights @ moved[d].astype(float) for d in np.flatnonzero(load)])  # (L, P, 3)
    down = np.concatenate([[0.0], depth[load]])
    up = np.concatenate([[0.0], depth[~load][::-1], depth[load][-1:]])
    up_force = np.concatenate([np.zeros((1, 3)), force[~load][::-1], force[load][-1:]])
    return Motion(
        displacement=PchipInterpolator(down, np.concatenate([np.zeros_like(at_particles[:1]), at_particles])),
        force=PchipInterpolator(down, np.concatenate([np.zeros((1, 3)), force[load]])),
        unload_force=PchipInterpolator(up, up_force),
        deepest_mm=float(depth[load][-1]),
    )
