"""Indentations of the base that find no equilibrium: their readings are left out and reported, the others are judged."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from gelforge.indentation.paths.places import gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.mismatch.fem.solutions import Solver, SolverFailed, Unsolved
from gelforge.mismatch.fem.solver import Base, base_of, forgetting
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.images_of_presses import image_of
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.readings.runs import DEPTH_DIGITS
from gelforge.mismatch.thresholds import FEWEST

SLACK_MM = 0.5 * 10.0**-DEPTH_DIGITS


def base_where_solved(solver: Solver, observations: Observations, effects: Iterable[Effect]) -> Base:
    """Return the base of the readings that it can be solved for; the observations of its context say what is left out.

    Raises SolverFailed where it is not known which those are, where they are fewer than FEWEST of the readings, and of a gel
    that softens: what an indentation left behind that was not solved is missing in all that follow.
    """
    effects, kept = list(effects), observations
    unsolved: list[Unsolved] = []
    while True:
        try:
            return base_of(solver, kept, effects)
        except SolverFailed as failure:
            unsolved += failure.presses
            fewer = without(solver, observations, unsolved)
            if solver.study.mechanics.effects.history.softens or len(fewer.force) == len(kept.force):
                raise
            share = len(fewer.force) / len(observations.force)
            if share < FEWEST:
                raise SolverFailed(
                    f"{_why(unsolved)}; {share:.0%} of the readings are left, at least {FEWEST:.0%} are needed: record"
                    " shallower indentations, or see where the study's own sites stop (`gelforge press`)"
                ) from None
            kept = fewer


def without(solver: Solver, observations: Observations, presses: Sequence[Unsolved]) -> Observations:
    """Return the observations without the readings of indentations that are not solved, at mirror images too, and say so.

    Of an indentation that went deeper than could be solved the readings of its loading to there are kept.
    """
    table = observations.table
    beyond, way_up_from = _bounds(solver, observations.sites, presses)[table["site"].to_numpy()].T
    deepest = table["deepest_mm"].to_numpy(float)
    cut = deepest > beyond + SLACK_MM
    up = (table["phase"] == "unload").to_numpy() & (cut | (deepest > way_up_from - SLACK_MM))
    left_out = up | (table["depth_mm"].to_numpy(float) > beyond + SLACK_MM)
    part = observations.chosen(~left_out)
    reached = part.table.groupby("press")["depth_mm"].transform("max")
    part = replace(
        part, table=part.table.assign(deepest_mm=np.where(cut[~left_out], reached, deepest[~left_out]))
    )
    reported = (
        f"{left_out.sum()} of {len(left_out)} readings are not judged, as {_why(presses)}; how these indentations"
        " softened the"
        " gel is not followed"
    )
    return part.at_sites(np.unique(part.table["site"])).saying(reported)


def _why(presses: Sequence[Unsolved]) -> str:
    return f"the simulation finds no equilibrium {'; '.join(one.words for one in presses)}"


def _bounds(solver: Solver, sites: np.ndarray, presses: Sequence[Unsolved]) -> np.ndarray:
    """Return per site (S, 2) [mm] the depth that is solved at most, and that from which on no unloading is."""
    bounds, study = (
        np.full((len(sites), 2), np.inf),
        forgetting(solver).study,
    )  # whose mirror images are solved
    for number, (x, y) in enumerate(sites):
        image, _ = image_of(study, PlannedCell("", float(x), float(y), (1.0,)))
        for one in presses:
            if within(gaps_to((image.x_mm, image.y_mm), (one.x_mm, one.y_mm))[0]):
                bounds[number] = np.minimum(bounds[number], [one.beyond_mm, one.unloading_from_mm])
    return bounds
