"""Tests of frames and counts: mirrored axes, and indentations recorded against those planned."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gelforge.indentation.paths.places import DEPTH_MATCH_MM, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.recording.plausibility.findings import Finding

if TYPE_CHECKING:
    from gelforge.recording.plausibility.session import SessionData


def mirrored_axes(data: SessionData) -> list[Finding]:
    """Return that the force axes mirror (determinant -1) where the session does not declare a left-handed stage."""
    axes = np.asarray(data.session.force.axes, float)
    if np.linalg.det(axes) > 0 or data.session.stage_to_sensor.handedness == "left":
        return []
    if np.allclose(axes, -np.eye(3)):
        remedy = "all three signs are reversed, as for the force on the other body: use the unit axes and force.acts_on"
    elif axes[2, 2] < 0 and np.linalg.det(axes[:2, :2]) > 0:
        remedy = "a sensor whose z points down has one lateral axis reversed too: correct a sign, or use force.acts_on"
    else:
        remedy = "correct a sign, or, if stage and force are in left-handed axes, set stage_to_sensor.handedness: left"
    return [
        Finding(
            test="mirrored_axes",
            level="error",
            channel="force.axes",
            value=-1.0,
            found=f"{[[round(float(v), 3) for v in row] for row in axes]} mirror (determinant -1, a rotation has 1)",
            remedy=remedy,
        )
    ]


def planned_count(data: SessionData) -> list[Finding]:
    """Return, as information, how many planned indentations of the sites that a session visits it does not hold."""
    if not data.cells:
        return []
    done = data.readings[data.readings["phase"].isin(["load", "dwell"])]
    deepest = done.groupby("press").agg(cell=("cell", "first"), depth=("depth_mm", "max"))
    missing = missing_indentations(
        {name: data.cells[name] for name in deepest["cell"].unique()},
        list(zip(deepest["cell"], deepest["depth"])),
    )
    if not missing:
        return []
    planned = len(missing) + len(deepest.drop_duplicates())
    named = ", ".join(f"{cell} {depth:g} mm" for cell, depth in missing[:3])
    return [
        Finding(
            test="planned_count",
            level="note",
            channel="plan",
            value=float(len(missing)),
            found=f"has {planned} indentations at the sites visited, {len(missing)} of them not recorded: {named}"
            + (", ..." if len(missing) > 3 else ""),
            remedy="the readings of the others are complete; record these too, or remove them from the plan",
        )
    ]


def missing_indentations(
    cells: Mapping[str, PlannedCell], done: list[tuple[str, float]]
) -> list[tuple[str, float]]:
    """Return the planned (site, depth) that were not recorded; done: site and deepest depth of each indentation."""
    depths: dict[str, list[float]] = {}
    for cell, depth in done:
        depths.setdefault(cell, []).append(depth)
    # one indentation follows a path
    return [
        (name, depth)
        for name, cell in cells.items()
        for depth in ((cell.deepest_mm,) if cell.follows_a_path else cell.depths_mm)
        if not within(min((abs(depth - d) for d in depths.get(name, [])), default=np.inf), DEPTH_MATCH_MM)
    ]
