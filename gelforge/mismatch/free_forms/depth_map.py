"""An error of the depth as a smooth function of the stage's place: a wavy surface, a bent rail."""

from __future__ import annotations

from collections.abc import Sequence

from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.kernels import FreeForm, Module, near, plane_modes, several_places, sites
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context
from gelforge.mismatch.model.solver_effects import per_depth


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the map [mm]; none of one place."""
    (deeper,) = CATALOGUE["contact_zero"].parameters
    table = context.observations.table
    if not several_places(table):
        return None
    at, rows = sites(table)
    basis = deeper.width * plane_modes(table)
    return Module(
        words="the depth reached from place to place",
        directions=context.observations.flat(per_depth(context)[:, :, None] * basis[:, None, :]),
        name="depth_map",
        says="the depth that is reached differs from place to place",
        map=at.assign(quantity="depth"),
        basis=basis[rows],
        unit="mm",
        of_labels=True,
        where=near,
        form_of=("contact_zero", "tilt"),
    )


FREE_FORM = FreeForm("depth_map", module)
