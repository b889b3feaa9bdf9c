"""Whether an indenter, and each of its parts, touches the sensor: before anything is solved, and in what was solved."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gelforge.config import ConfigError, Indenter, Study
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.effects.kinematics import touches_a_slope
from gelforge.mechanics.indenters.shapes import DOWN, Several, Turned, rotation_of
from gelforge.mechanics.indenters.shapes import Indenter as Shape

if TYPE_CHECKING:
    from gelforge.indentation.paths.planned_cell import PlannedCell
    from gelforge.mechanics.contact.state import State
    from gelforge.mechanics.meshes.mesh import Mesh


def check_reaches(study: Study, shape: Shape, cells: dict[str, PlannedCell]) -> None:
    """Refuse sites that the indenter, or a part of it that must touch, cannot reach. Raises ConfigError.

    Of a block whose flat top the indenter meets squarely all is known beforehand; elsewhere what was solved decides
    (`untouched`).
    """
    sensor, effects = study.sensor, study.mechanics.effects
    width, block = np.array([sensor.width_x_mm, sensor.width_y_mm]), sensor.shape.kind == "block"
    slope = touches_a_slope(effects)
    sections, parts = {}, {}
    for cell in cells.values():
        deepest = cell.deepest_mm + max(effects.kinematics.contact_zero_mm, 0.0)
        if deepest not in sections:  # most sites of a plan press equally deep
            sections[deepest] = shape.section(deepest if block else 2 * shape.size)
            parts[deepest] = list(_parts(study.indenter, shape, deepest))
        places = np.array(cell.shears_mm or ((0.0, 0.0),)) + [cell.x_mm, cell.y_mm]
        if not _over(sections[deepest], places, width):
            away = np.hypot(*sections[deepest][0, :2])
            raise ConfigError(
                f"site {cell.name}: no depth touches: at its deepest, {cell.deepest_mm:g} mm, the indenter lies next to the "
                f"sensor, {away:.3g} mm from the position ({cell.x_mm:g}, {cell.y_mm:g}) mm; correct its origin_mm or "
                "offset_mm, or the plan"
            )
        if not block or cell.tilts_deg or cell.twists_deg or slope:
            continue
        for number, (part, height, discs) in enumerate(parts[deepest], start=1):
            reached = height < deepest
            if part.need_not_touch or (reached and _over(discs, places, width)):
                continue
            why = "lies next to the sensor there" if reached else f"lies {height:.4g} mm over the lowest part"
            raise ConfigError(
                f"site {cell.name}: indenter, part {number} never touches: it {why}, the deepest depth is {deepest:g} mm; "
                "correct its offset_mm or the plan, or set its need_not_touch: true"
            )


def check_over_sensor(study: Study, cells: dict[str, PlannedCell]) -> None:
    """Refuse positions that have no surface of a dome or of surface files below them. Raises ConfigError."""
    sensor = study.sensor
    if sensor.shape.kind == "block":
        return
    if sensor.shape.kind == "surfaces":
        # loads the mesher's files
        from gelforge.indentation.sensor.sensor_mesh import sensor_solids, tops_over
        from gelforge.mechanics.indenters.closed_surface import SurfaceError

        try:
            solids = sensor_solids(sensor)
        except SurfaceError as error:
            raise ConfigError(f"sensor: {error}") from None
    half = np.array([sensor.width_x_mm, sensor.width_y_mm]) / 2
    for cell in cells.values():
        place = np.array([cell.x_mm, cell.y_mm])
        dome = sensor.shape.kind == "dome"
        if np.hypot(*(place / half - 1)) < 1 if dome else tops_over(solids, *place):
            continue
        raise ConfigError(
            f"site {cell.name}: no surface of the sensor lies below ({cell.x_mm:g}, {cell.y_mm:g}) mm; move the position or "
            "make plan.grid.margin_mm larger"
        )


def touched_parts(shape: Shape, mesh: Mesh, states: Sequence[State]) -> list[bool]:
    """Return of each shape of an indenter whether a contact node is nearest to it in any of the states."""
    rotation, several = np.eye(3), shape
    while isinstance(several, Turned):
        rotation, several = rotation @ several.rotation, several.shape
    if not isinstance(several, Several):
        return [any(state.contact_state.any() for state in states)]
    touched = np.zeros(len(several.shapes), bool)
    for state in states:
        nodes = mesh.surface.nodes[state.contact_state > 0]
        turn = rotation_of(state.centre[3:]) if len(state.centre) > 3 else np.eye(3)
        points = (mesh.X[nodes] + state.u[nodes] - state.centre[:3]) @ (turn @ rotation)
        if len(points):
            placed = zip(several.shapes, several.offsets)
            gaps = [part.distance(points - offset)[0] for part, offset in placed]
            touched[np.unique(np.argmin(gaps, axis=0))] = True
    return touched.tolist()


def untouched(cell: Cell, indenter: Indenter) -> str:
    """Return why a solved site is no label: nothing touched at any depth, or a part that must touch did not; else ""."""
    touched = np.array(cell.attributes["touched_parts"], bool)
    if not touched.any():
        return (
            f"no depth touches: the indenter stays clear of the sensor down to {cell.arrays['depth_mm'].max():g} mm; press "
            "deeper, or correct the indenter's origin_mm, the plan or contact_zero_mm"
        )
    missing = [k + 1 for k, part in enumerate(indenter.shapes) if not (touched[k] or part.need_not_touch)]
    if not missing:
        return ""
    return (
        f"part(s) {missing} of the indenter never touch(es); press deeper, correct offset_mm, or set need_not_touch: true "
        "of what may stay clear"
    )


def _over(discs: np.ndarray, places: np.ndarray, width: np.ndarray) -> bool:
    """Return whether any of discs (n, 3) about any of places (m, 2) lies over the rectangle from 0 to width (2,)."""
    middle = places[:, None] + discs[:, :2]  # (m, n, 2)
    away = np.linalg.norm(middle - np.clip(middle, 0.0, width), axis=-1)
    return bool((away <= discs[:, 2]).any())


def _parts(indenter: Indenter, shape: Shape, deepest: float):
    """Yield each of several parts, its height over the lowest part [mm], and the discs of its section at a depth."""
    rotation, several = (shape.rotation, shape.shape) if isinstance(shape, Turned) else (np.eye(3), shape)
    if not isinstance(several, Several):
        return
    lowest = shape.support(DOWN)
    for part, body, offset in zip(indenter.parts, several.shapes, several.offsets @ rotation.T):
        turned = Turned(body, rotation)
        height = lowest - (turned.support(DOWN) + offset @ DOWN)
        yield part, float(height), turned.section(max(deepest - height, 0.0)) + [*offset[:2], 0.0]
