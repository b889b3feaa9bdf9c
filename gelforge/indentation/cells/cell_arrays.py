"""States of the finite-element model to the arrays of a site's file."""

from __future__ import annotations

import numpy as np

from gelforge.config import Mechanics, Sensor
from gelforge.indentation.cells import binning
from gelforge.indentation.cells.cut import plane_cut
from gelforge.indentation.sensor.unrolled import bin_points
from gelforge.mechanics.contact.state import State
from gelforge.mechanics.meshes.mesh import Mesh


def _stack(states: list[State], name: str, shape: tuple[int, ...]) -> np.ndarray:
    return np.stack([getattr(state, name) for state in states]) if states else np.zeros((0, *shape))


def force_arrays(
    mesh: Mesh, states: list[State], sensor: Sensor, mechanics: Mechanics
) -> dict[str, np.ndarray]:
    surface = mesh.surface
    top, S = surface.nodes[surface.top], len(surface.nodes)
    normal, shear = _stack(states, "normal_force", (S, 3)), _stack(states, "friction_force", (S, 3))
    shares = binning.bin_shares(mesh, sensor, mechanics.binning)
    bin_normal, bin_shear = (binning.bin_forces(force, shares) for force in (normal, shear))
    return {
        "total_force_N": (normal + shear).sum(axis=1),
        "reaction_N": _stack(states, "reaction", (3,)),
        "bin_force_N": binning.without_dust(bin_normal + bin_shear),
        "bin_normal_N": binning.without_dust(bin_normal),
        "bin_shear_N": binning.without_dust(bin_shear),
        "side_force_N": (normal + shear)[:, ~surface.top].sum(axis=1),
        "node_xy_mm": mesh.X[top, :2],
        "node_area_mm2": binning.node_areas(mesh)[surface.top],
        "node_normal_N": normal[:, surface.top],
        "node_shear_N": shear[:, surface.top],
        "node_state": _stack(states, "contact_state", (S,)).astype(np.int8)[:, surface.top],
        "node_displacement_mm": _displacement(states, top),
    }


def _displacement(states: list[State], nodes: np.ndarray) -> np.ndarray:
    """Return the displacement (D, n, 3) of some nodes [mm] as float32: 1e-7 mm is beyond any camera."""
    moved = np.array([state.u[nodes] for state in states], dtype=np.float32)
    return moved.reshape(len(states), len(nodes), 3)


def section_arrays(mesh: Mesh, states: list[State], y_mm: float) -> dict[str, np.ndarray]:
    """Return the mesh plane y = const nearest the site, for drawing; a cut through the site itself otherwise."""
    if mesh.elements.shape[1] == 10:
        polygons, element, values = plane_cut(mesh.X, mesh.elements, y_mm)
        displacement = [values @ state.u for state in states]
        return {
            "section_node_mm": values @ mesh.X,
            "section_quad": polygons.astype(np.int32),
            "section_region": mesh.region[element],
            "section_displacement_mm": np.array(displacement, np.float32).reshape(len(states), -1, 3),
        }
    face = mesh.elements[:, [0, 1, 5, 4]]
    side = mesh.X[face, 1].mean(axis=1)
    # Lines of the base grid run through the whole mesh; the largest cells lie on them alone.
    size = mesh.X[mesh.elements[:, 3], 1] - mesh.X[mesh.elements[:, 0], 1]
    lines = np.unique(np.round(side[size > 0.6 * size.max()], 9))
    on_plane = np.isclose(side, lines[np.argmin(np.abs(lines - y_mm))], atol=1e-8)
    nodes, quads = np.unique(face[on_plane], return_inverse=True)
    return {
        "section_node_mm": mesh.X[nodes],
        "section_quad": quads.reshape(-1, 4).astype(np.int32),
        "section_region": mesh.region[on_plane],
        "section_displacement_mm": _displacement(states, nodes),
    }


def gel_elements(mesh: Mesh, sensor: Sensor) -> np.ndarray:
    """Return the elements (E, 8) or (E, 10) of the layers that the camera sees move."""
    layers = [layer.name for layer in sensor.imaged_layers]
    return mesh.elements[np.isin(mesh.region, [mesh.regions.index(name) for name in layers])]


def gel_arrays(mesh: Mesh, states: list[State], sensor: Sensor) -> dict[str, np.ndarray]:
    """Return mesh and displacement of the layers that the camera sees move."""
    nodes, elements = np.unique(gel_elements(mesh, sensor), return_inverse=True)
    corners = mesh.elements.shape[1]
    return {
        "gel_node_mm": mesh.X[nodes],
        {8: "gel_hex", 10: "gel_tet"}[corners]: elements.reshape(-1, corners).astype(np.int32),
        "gel_displacement_mm": _displacement(states, nodes),
    }


def moment_shift(arrays: dict[str, np.ndarray], sensor: Sensor) -> list[float]:
    """Return per depth how much the moment about the sensor's centre differs between bins and nodes [N mm]."""
    middle = np.array([sensor.width_x_mm, sensor.width_y_mm]) / 2
    centres = bin_points(sensor)[:, :2] - middle
    nodes = arrays["node_xy_mm"] - middle

    def moment(arms, forces):  # of forces in the plane z = 0
        x, y = arms[:, 0], arms[:, 1]
        fx, fy, fz = np.moveaxis(forces, -1, 0)
        return np.stack([(y * fz).sum(-1), (-x * fz).sum(-1), (x * fy - y * fx).sum(-1)], axis=-1)

    of_nodes = moment(nodes, arrays["node_normal_N"] + arrays["node_shear_N"])
    shift = moment(centres, arrays["bin_force_N"]) - of_nodes
    return [float(value) for value in np.linalg.norm(shift, axis=-1)]
