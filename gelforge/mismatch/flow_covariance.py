"""What the flow of image regions may differ by for known reasons, beside the forces: the covariance of both channels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from gelforge.indentation.error_bars import PART_TOTALS
from gelforge.mismatch.covariance import Covariance, Draws, estimated_noise
from gelforge.mismatch.flow_images import DRAWINGS, REGIONS
from gelforge.mismatch.flow_model import OTHER_BLUR_PX, OTHER_DIAMETER, FlowModel
from gelforge.mismatch.flow_rows import Rows
from gelforge.mismatch.problem import Problem

# The real particles are one placement, the prediction a mean over some: their difference stays from press to press of a
# site but for what lies elsewhere in the moved image. Measured between two depths (benchmarks/flow_channel.py).
SHARED = 0.8  # of its variance
# Of the flow of a region: what drawing leaves out of a real image (glare, particles that are no balls, distortion).
DRAWN_SHARE = 0.01
LEAST_PX = 0.005  # an 8-bit image holds no smaller mean motion


def flow_covariance(
    problem: Problem,
    model: FlowModel,
    drawn: np.ndarray,
    few: np.ndarray,
    rows: Rows,
    labels: pd.DataFrame,
) -> Covariance:
    """Return the covariance of both channels.

    Of the flow: independent its images' noise and what drawing leaves out; per site, region and direction the reference
    frame's noise and where the particles are (their scatter over placements); shared by all the touchdown of a press with
    images, in force and flow alike, the laws' directions, the discretisation, and two other looks of the particles.
    """
    forces = problem.covariance
    *depth, press, alike, common = forces.levels
    n, seen = rows.entries, model.seen
    noise = np.stack([p.noise for p in seen])
    images = np.array([p.images for p in seen])[:, None, None]
    base = drawn.mean(axis=1)
    scatter = _smoothed(drawn.var(axis=1, ddof=1)) * (1 + 1 / DRAWINGS)
    variance = (
        noise**2 / images
        + (1 - SHARED) * scatter
        + (DRAWN_SHARE * _smoothed(base**2) ** 0.5) ** 2
        + LEAST_PX**2
    )
    own = labels.iloc[n:]
    region = pd.factorize(
        own["site"].astype(str) + "/" + own["region"].astype(str) + "/" + own["axis"].astype(str)
    )[0]
    placed = np.column_stack(
        [
            rows.flat(np.sqrt(SHARED * scatter)),
            rows.flat(noise),
            *np.zeros((press.directions.shape[1] - 2, len(own))),
        ]
    )
    by_press, shared_force, shared_flow = _touchdown(problem, model, few, rows)
    laws = np.zeros((len(own), common.directions.shape[1]))
    for k, key in enumerate(sorted_laws(model)):
        laws[:, k] = rows.flat(model.change_along(key, 1.0, few))
    laws += shared_flow["session"]
    flow_alone = np.column_stack([rows.flat(change) for change in _doubts(model, few)])
    q = flow_alone.shape[1]
    return Covariance(
        np.concatenate([forces.variance, rows.flat(variance)]),
        (
            *(_of_forces(level, np.arange(len(own))) for level in depth),
            Draws(
                np.concatenate([press.group, press.group.max() + 1 + region]), np.vstack([by_press, placed])
            ),
            _of_forces(alike, pd.factorize(own["site"])[0]),
            Draws(
                np.zeros(len(labels), dtype=int),
                np.block(
                    [
                        [common.directions, shared_force, np.zeros((n, q))],
                        [laws, shared_flow["press"], flow_alone],
                    ]
                ),
            ),
        ),
        estimated_noise(rows.observations),
    )


def _of_forces(level: Draws, own: np.ndarray) -> Draws:
    """Return draws of the forces that the flow has no part in; own (f,) int: groups of its entries."""
    nothing = np.zeros((len(own), level.directions.shape[1]))
    return Draws(
        np.concatenate([level.group, level.group.max() + 1 + own]), np.vstack([level.directions, nothing])
    )


def sorted_laws(model: FlowModel) -> list[str]:
    """Return the laws' directions in the order of Base.law."""
    keys = [key for key in next(iter(model.coarse.values())).along if key.startswith("law ")]
    return sorted(keys, key=lambda key: (key.rsplit(" ", 1)[0], int(key.rsplit(" ", 1)[1])))


def _smoothed(square: np.ndarray) -> np.ndarray:
    """Return a square (F, m, 2) averaged over the 3 x 3 regions around each and both directions."""
    F = len(square)
    grid = square.mean(axis=-1).reshape(F, REGIONS, REGIONS)
    wide = np.pad(grid, ((0, 0), (1, 1), (1, 1)), mode="edge")
    near = sum(wide[:, i : i + REGIONS, j : j + REGIONS] for i in range(3) for j in range(3)) / 9
    return np.repeat(near.reshape(F, -1, 1), 2, axis=-1)


def _touchdown(problem: Problem, model: FlowModel, few: np.ndarray, rows: Rows):
    """Return the forces' directions per press without the touchdown of presses with images, and these as shared columns."""
    *_, press, alike, common = problem.covariance.levels
    labels, slope = problem.labels, model.slope(few)
    by_press = press.directions.copy()
    force, flow = [], []
    session = np.zeros((rows.shown.sum() * 2, common.directions.shape[1]))
    last = model.base.law.shape[-1] + alike.directions.shape[1]  # columns of laws and floor come first
    for k, seen in enumerate(model.seen):
        own = (labels["press"] == seen.row["press"]).to_numpy()
        sd = problem.observations.touchdown_mm[int(seen.row.name)]
        alone = np.zeros_like(slope)
        alone[k] = sd * slope[k]
        if np.asarray(problem.observations.zero_by)[int(seen.row.name)] == "session":
            column = last + int(np.argmax(np.abs(common.directions[own][:, last:]).sum(axis=0)))
            session[:, column] += rows.flat(alone)
            continue
        column = np.where(own, by_press[:, -1], 0.0)
        by_press[own, -1] = 0.0
        force.append(column)
        flow.append(rows.flat(alone))
    n, f = rows.entries, len(session)
    return (
        by_press,
        np.column_stack(force) if force else np.zeros((n, 0)),
        {"session": session, "press": np.column_stack(flow) if flow else np.zeros((f, 0))},
    )


def _doubts(model: FlowModel, few: np.ndarray) -> list[np.ndarray]:
    """Return changes of the flow (F, m, 2) by one standard deviation of what is not known: mesh, blur, diameter."""
    more = []
    for press in model.seen:
        site, d = int(press.row["site"]), model.depth(press)
        coarse = model.weights[site] @ model.coarse[site].base[d].astype(float)
        more.append(coarse - model.moved(press, model.few))
    blurred = [
        replace(
            p.eye,
            imaging=p.eye.imaging.model_copy(update={"blur_px": p.eye.imaging.blur_px + OTHER_BLUR_PX}),
        )
        for p in model.seen
    ]
    other = replace(model.few, diameter_mm=model.few.diameter_mm * OTHER_DIAMETER)
    larger = replace(model, few=other, scenes={}, changes={})
    return [
        PART_TOTALS * (model.flows_with(more) - few),
        model.flows_with([None] * len(model.seen), blurred) - few,
        larger.flows_with([None] * len(model.seen)) - few,
    ]
