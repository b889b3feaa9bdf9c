"""Single readings that nothing beside them shares: glitches of a force sensor, left out before anything is asked.

No effect changes one reading of one indentation by many standard deviations and leaves its neighbours in depth, time and
place as they are. One such reading is evidence for something that differs from one indentation to the next, though, and
would be reported as that.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.kernels import kernels_of
from gelforge.mismatch.evidence.problem import Problem, never_solved
from gelforge.mismatch.inference.patterns import AXES
from gelforge.mismatch.readings.observations import Observations, SetAside

SPIKE = 5.0  # standard deviations from what all other readings say of it; normal noise: once in two million readings
ROOM = 3.0  # plausible sizes of a discrepancy, of every kernel: 30 % of the force each, and no spike
MOST = 0.004  # of the entries, at least one: what strikes more of them is no glitch


def without_spikes(observations: Observations, base: np.ndarray, covariance: Covariance) -> Observations:
    """Return the observations without single entries far off all others; each is reported in `set_aside`.

    base (R, 3) [N]; covariance of the n entries. What strikes several readings of one indentation the judge must explain:
    that press keeps them. So do all where more than MOST are far off.
    """
    found = spikes(Problem(observations, base, covariance, (), {}, never_solved, {}))
    labels = observations.labels().iloc[list(found)].assign(away=found.values())
    labels = labels[labels.groupby("press")["reading"].transform("nunique") == 1]
    if labels.empty or len(labels) > max(1, MOST * len(covariance)):
        return observations
    force = observations.force.copy()
    force[labels["reading"], labels["axis"]] = np.nan
    reported = tuple(
        SetAside(
            session=row.session,
            press=row.press.removeprefix(f"{row.session}/"),
            time_s=row.time_s,
            depth_mm=row.depth_mm,
            axis=AXES[row.axis],
            size=round(abs(row.away), 1),
            reason="far from what the other readings of its indentation, place and depth say of it",
        )
        for row in labels.itertuples()
    )
    return replace(observations, force=force, set_aside=(*observations.set_aside, *reported))


def spikes(problem: Problem) -> dict[int, float]:
    """Return the entries far off all others, by number, and how far [standard deviations]; found one by one.

    Whatever is smooth in depth, place, time or path, or in the depth of one indentation, is free to ROOM times what is
    plausible. How far: r_i less its mean given all other entries, over its standard deviation, which is (C^-1 r)_i /
    sqrt((C^-1)_ii).
    """
    covariance, residual = _with_room(problem), problem.residual
    left = np.arange(len(residual))
    found: dict[int, float] = {}
    while len(found) <= max(1, MOST * len(residual)):
        part = covariance.restricted(left)
        white = part.whiten(residual[left])
        tried = np.argsort(-np.abs(white))[:200]
        single = np.zeros((len(left), len(tried)))
        single[tried, np.arange(len(tried))] = 1.0
        columns = part.whiten(single)
        away = columns.T @ white / np.linalg.norm(columns, axis=0)
        farthest = np.argmax(np.abs(away))
        if abs(away[farthest]) <= SPIKE:
            break
        found[int(left[tried[farthest]])] = float(away[farthest])
        left = np.delete(left, tried[farthest])
    return found


def _with_room(problem: Problem) -> Covariance:
    """Return the covariance with room for whatever is not a single reading's."""
    rounding = problem.observations.flat(problem.observations.rounding_N)
    # a reading that falls into the next step is no spike: as if each were rounded by itself, too
    covariance = problem.covariance.scattering(rounding**2)
    kernels = kernels_of(problem)
    kernels.sort(key=lambda kernel: kernel.groups is None)  # those of each indentation before what all share
    for kernel in kernels:
        covariance = kernel.beside(covariance, ROOM)
    return covariance
