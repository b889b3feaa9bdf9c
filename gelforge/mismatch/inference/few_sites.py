"""Nonlinear changes solved at a few sites: at the others the linear change, bent as it is at those that were solved.

How much more, or less, a body changes than in proportion depends on the depth far more than on the place: a polynomial of
depth, one for pressing and one for sideways forces, carries it from the few sites to all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.evidence.spread import spread_out
from gelforge.mismatch.model.effect import unturned
from gelforge.mismatch.terms.problem import Problem
from gelforge.mismatch.thresholds import MOST_SITES, OBSERVABLE

ORDER = 2  # of the polynomial
STIFFNESS = 1e-3  # of the prior that holds the bend at none, as a share of the change's mean square


def at_few_sites(problem: Problem, most: int = MOST_SITES) -> Problem:
    """Return the problem with forces solved at a few sites; itself where there are no more, or nothing says how to bend.

    What is solved in order, or switched on, is solved everywhere.
    """
    if problem.read_with is None or len(problem.observations.sites) <= most:
        return problem
    table = problem.observations.table

    def change_of(parts: Sequence[Candidate], amounts: Sequence[np.ndarray], rows: np.ndarray) -> np.ndarray:
        linear, near = problem.linear_change(parts, amounts), rows
        if not (any(part.binary for part in parts) or problem.path_dependent(parts)):
            near = np.isin(table["site"], chosen_sites(problem, linear, parts, most))
        solved = problem.forces_with(parts, amounts, near) - problem.base
        return bent(linear, solved, near, table["depth_mm"].to_numpy(float))

    return problem.with_changes(problem.solves, change_of)


def bent(linear: np.ndarray, solved: np.ndarray, near: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return a change (R, 3) [N]: as solved at the rows near (R,) bool, elsewhere linear, bent by a polynomial of depth."""
    change = linear.copy()
    change[near] = np.where(np.isfinite(solved[near]), solved[near], linear[near])
    powers = (depth / max(depth.max(initial=0.0), np.finfo(float).tiny))[:, None] ** np.arange(ORDER + 1)
    for axes in ([2], [0, 1]):
        columns = (linear[:, axes, None] * powers[:, None, :]).reshape(-1, ORDER + 1)
        rows = np.repeat(near, len(axes))
        more = (change[:, axes] - linear[:, axes]).ravel()
        hold = STIFFNESS * np.mean(columns[rows, 0] ** 2) * rows.sum() * np.eye(ORDER + 1)
        A = columns[rows].T @ columns[rows] + hold
        if A.any():
            bend = columns @ np.linalg.lstsq(A, columns[rows].T @ more[rows], rcond=None)[0]
            change[:, axes] += np.where(near[:, None], 0.0, bend.reshape(-1, len(axes)))
    return change


def chosen_sites(problem: Problem, linear: np.ndarray, parts: Sequence[Candidate], most: int) -> np.ndarray:
    """Return the numbers of the sites that are solved for a linear change (R, 3) [N]: observable ones, spread out.

    The first shows it most. Of effects that are the same from all sides one eighth of a square stands for all of it.
    """
    site = problem.observations.table["site"].to_numpy()
    size = np.sqrt(np.bincount(site, (linear**2).sum(axis=1), len(problem.observations.sites)))
    observable = np.flatnonzero(size > OBSERVABLE * size.max())
    places = problem.observations.sites[observable]
    if all("x_mm" not in part.shape and problem.effects[part.name].turned is unturned for part in parts):
        folded = np.sort(np.abs(places - places.mean(axis=0)).round(3), axis=1)
        _, first = np.unique(folded, axis=0, return_index=True)
        observable, places = observable[first], folded[first]
    return observable[spread_out(places, most, int(np.argmax(size[observable])))]
