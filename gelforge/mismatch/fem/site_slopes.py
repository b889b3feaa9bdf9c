"""The derivatives of one site's forces along all that a verdict may ask for, solved before any recording is looked at."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from gelforge.hdf5 import writing
from gelforge.indentation.cells.cell_file import Cell, write_timings
from gelforge.indentation.paths.places import DIGITS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.sensitivities import Derivative, Variation
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.evidence.candidates import effects_of_forces
from gelforge.mismatch.fem.asked import asked_of
from gelforge.mismatch.fem.solutions import Solver, along_laws, each_derivative
from gelforge.mismatch.fem.solver import forgetting
from gelforge.mismatch.fem.stored import FORMAT, place_digest, slope_digest
from gelforge.mismatch.free_forms import required
from gelforge.mismatch.model.effect import Context
from gelforge.mismatch.model.images_of_presses import image_of

# Depth zero is found for every indentation, or once: a tilt is then seen differently.
ZERO_BY = ("press", "session")
NOTHING = Cell({"total_force_N": np.empty((0, 3))}, {})


@dataclass(frozen=True)
class SiteSlopes:
    """What was found at a place that stands for its mirror images."""

    planned: PlannedCell
    asked: Mapping[str, tuple[Variation, dict]]  # by key: the variation and what it is about
    base: Cell
    found: Mapping[str, Derivative | str]  # by key, or the reason why there is none
    seconds: float


def slopes_of_site(solver: Solver, cell: PlannedCell) -> SiteSlopes:
    """Return the derivatives at a planned site's place, or the image that stands for it, as deep as the coarser mesh goes.

    They are those of a straight indentation through the site's depths, however it goes on from there.

    Parameters
    ----------
    solver : Solver
        Of the study.
    cell : PlannedCell
        The site.

    Returns
    -------
    SiteSlopes
        Base forces [N] and derivatives by key, or the reason why there is none.
    """
    clock = time.perf_counter()
    solver = forgetting(solver)
    depths = tuple(float(d) for d in np.unique(cell.depths_mm))
    straight = PlannedCell("", round(cell.x_mm, DIGITS), round(cell.y_mm, DIGITS), depths)
    planned, _ = image_of(solver.study, straight)
    asked = asked_at(solver, planned)
    variations = {key: one for key, (one, _) in asked.items()}
    study, laws = solver.coarse, dict(solver.laws)
    try:
        base, derivatives = each_derivative(study, laws, planned, variations)
    except NotConverged:
        reached = simulate_cell(study, laws, planned).attributes["last_good_depth_mm"]
        planned = replace(planned, depths_mm=tuple(d for d in depths if d <= reached))
        if not planned.depths_mm:
            return SiteSlopes(planned, {}, NOTHING, {}, time.perf_counter() - clock)
        base, derivatives = each_derivative(study, laws, planned, variations)
    return SiteSlopes(planned, asked, base, derivatives, time.perf_counter() - clock)


def asked_at(solver: Solver, planned: PlannedCell) -> dict[str, tuple[Variation, dict]]:
    """Return what is differentiated along at a place by name, each with its effect, parameter, unit and hyperparameters."""
    blank = Context.before_readings(solver.study)  # all that there could be
    effects = required(solver.study, effects_of_forces(solver.study).values())
    variations: dict[str, tuple[Variation, dict]] = {}
    words: dict[str, object]
    known = []
    for zero_by in ZERO_BY:
        for one in asked_of(replace(solver, zero_by=zero_by), effects, blank, planned):
            key, variation = one.key, one.variation
            if variation.inputs in known:
                continue
            known.append(variation.inputs)
            parameter = one.effect.parameters[one.which]
            words = {"effect": one.effect.name, "parameter": parameter.name, "unit": parameter.unit}
            variations[key if key not in variations else f"{key} by {zero_by}"] = (
                variation,
                words | {"hyperparameters": dict(one.hyperparameters), "depth_zero_by": zero_by},
            )
    for key, variation in along_laws(solver, solver.coarse).items():
        words = {"effect": "", "parameter": key, "unit": "standard deviation", "hyperparameters": {}}
        variations[key] = variation, words
    return variations


def write_site_slopes(path: Path, solver: Solver, site: SiteSlopes) -> None:
    """Write the derivatives of a site into a file of their own, whole or not at all; `read_stored` reads it.

    Parameters
    ----------
    path : Path
        The HDF5 file; seconds are written next to it.
    solver : Solver
        The one that found them.
    site : SiteSlopes
        As `slopes_of_site` returns it.
    """
    coarse, planned = forgetting(solver).coarse, site.planned
    place = place_digest(coarse, solver.laws, planned.x_mm, planned.y_mm)
    about = {
        key: {"name": key, **words, "digest": slope_digest(place, one)}
        for key, (one, words) in site.asked.items()
    }
    known = {key: one for key, one in site.found.items() if not isinstance(one, str)}
    lists = {
        "parameters": [about[key] for key in known],
        "missing": [about[key] | {"reason": one} for key, one in site.found.items() if key not in known],
    }
    arrays = {
        "depth_mm": ("mm", np.array(planned.depths_mm)),
        "total_force_N": ("N", site.base.arrays["total_force_N"]),
        "slope_total": ("N/unit", np.array([one.total for one in known.values()])),
    }
    with writing(path) as file:
        file.attrs["format"] = FORMAT
        file.attrs["x_mm"], file.attrs["y_mm"], file.attrs["place"] = planned.x_mm, planned.y_mm, place
        for name, content in lists.items():  # datasets: an attribute holds 64 kB
            file.create_dataset(name, data=json.dumps(content))
        for name, (unit, values) in arrays.items():
            large = {"compression": "gzip", "shuffle": True} if values.size > 4096 else {}
            file.create_dataset(name, data=values, **large).attrs["units"] = unit
    write_timings(path, {"seconds": site.seconds})
