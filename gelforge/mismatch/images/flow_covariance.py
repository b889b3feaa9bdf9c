"""What the flow of image regions may differ by for known reasons, next to the forces: the covariance of both channels."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from scipy.ndimage import uniform_filter

from gelforge.mismatch.evidence.covariance import Covariance, Draws, estimated_noise
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.images.flow_images import REGIONS
from gelforge.mismatch.images.flow_model import FlowModel
from gelforge.mismatch.readings.observations import Observations

# Of the flow's difference to the mesh of twice the sizes: about the third that is left of an error of second order
# (Richardson 1911).
PART = 0.3


@dataclass(frozen=True, eq=False)
class Rows:
    """Where the flow stands among the readings and the entries."""

    observations: Observations
    entries: int  # of force
    shown: np.ndarray  # (F, m) bool

    def flat(self, flow: np.ndarray) -> np.ndarray:
        """Return the entries of a quantity (F, m, 2, ...): regions that show the gel, u and v in turn."""
        return flow[self.shown].reshape(-1, *flow.shape[3:])

    def as_readings(self, flow: np.ndarray) -> np.ndarray:
        """Return the rows (F m, 3) of a flow (F, m, 2), nothing in the place of Fz."""
        rows = np.where(self.shown[..., None], flow, np.nan).reshape(-1, 2)
        return np.column_stack([rows, np.full(len(rows), np.nan)])


@dataclass(frozen=True)
class Scatter:
    """How far one placement of particles, as the real ones are, is off the mean over placements: standard deviations.

    Where the particles of a region are near the camera, or at the side that moves more, it shows the same share too much of
    the flow in all images; what is left differs from site to site, and there is one indentation at each.
    """

    shared: np.ndarray  # (F, m, 2) [px] by the regions' shares of the flow
    correlation: float  # correlation of these shares between neighbours, taken for that of what is left too
    rest: np.ndarray  # (F, m, 2) [px] what is left


def flow_covariance(problem: Problem, model: FlowModel, rows: Rows, labels: pd.DataFrame) -> Covariance:
    """Return the covariance of both channels.

    Of the flow: independent its images' noise, what drawing leaves out and where the particles of every region are
    (`Scatter`); per site and direction the reference frame's noise, neighbours alike in part; per indentation its contact
    point, in force and flow alike; shared by all their share of the flow in all images, sessions' contact points, the laws'
    directions, the discretisation, at which heights the particles are that are seen, and two other looks of the particles.
    """
    forces = problem.covariance
    *depth, press, solved, common = forces.levels
    n, noise = rows.entries, np.stack([p.noise for p in model.seen])
    images = np.array([p.images for p in model.seen])[:, None, None]
    base = model.drawn.mean(axis=1)
    scatter = scatter_of(model.drawn, np.all(rows.shown, axis=0))
    # an 8-bit image holds no smaller mean motion; of a region's flow what drawing leaves out (glare, distortion)
    least_px, undrawn = 0.005, 0.01
    variance = noise**2 / images + scatter.rest**2 + least_px**2
    variance = variance + (undrawn * _smoothed(base**2) ** 0.5) ** 2
    flow = labels.iloc[n:]
    f = len(flow)
    seen_at = flow.groupby(["site", "axis"]).ngroup().to_numpy()
    root = neighbours(scatter.correlation)[flow["region"].to_numpy(int)]
    placed = root * rows.flat(noise)[:, None]
    seen, reading = rows.observations, flow["reading"].to_numpy()
    depths = seen.press_depth_mm[reading], seen.session_depth_mm[reading]
    by_press, by_session = contact_points(problem, flow, depths, rows.flat(model.slope()))
    laws = np.zeros((f, common.directions.shape[1]))
    for k, key in enumerate(sorted_laws(model)):
        laws[:, k] = rows.flat(model.change_along(key))
    first = model.base.law.shape[-1] + solved.directions.shape[1]  # columns of laws and floor come first
    laws[:, first : first + by_session.shape[1]] = by_session
    regions = root * rows.flat(scatter.shared)[:, None]
    flow_alone = np.column_stack([*(rows.flat(change) for change in _doubts(model)), regions])
    shared = [[common.directions, np.zeros((n, flow_alone.shape[1]))], [laws, flow_alone]]

    def both(
        group: np.ndarray, force: np.ndarray, flow_group: np.ndarray, flow: np.ndarray | None = None
    ) -> Draws:
        """Return draws of the forces in groups (n,) and, in groups (f,), of the flow; none of it by default."""
        flow = np.zeros((f, force.shape[1])) if flow is None else flow
        return Draws(np.concatenate([group, flow_group]).astype(int), np.vstack([force, flow]))

    def joined(column: str, group: np.ndarray) -> np.ndarray:
        """Return the groups of the flow as those (n,) of the forces at its site or of its press."""
        of_force = dict(zip(labels[column].iloc[:n], group))
        return np.array([of_force[value] for value in flow[column]])

    apart = press.group.max() + 1 + seen_at
    levels = (
        *(both(level.group, level.directions, level.group.max() + 1 + np.arange(f)) for level in depth),
        both(press.group, np.zeros((n, placed.shape[1])), apart, placed),
        both(press.group, press.directions, joined("press", press.group), by_press),
        # errors of changes are drawn for its site
        both(solved.group, solved.directions, joined("site", solved.group)),
        Draws(np.zeros(len(labels), dtype=int), np.block(shared)),
    )
    variances = np.concatenate([forces.variance, rows.flat(variance)])
    return Covariance(variances, levels, estimated_noise(rows.observations))


def scatter_of(drawn: np.ndarray, shown: np.ndarray) -> Scatter:
    """Return the scatter of drawn flows (F, K, m, 2) [px] over K placements.

    Correlations are those of regions (m,) bool that show the gel.
    """
    K, base = drawn.shape[1], drawn.mean(axis=1, keepdims=True)
    off, size = drawn - base, np.sum(base**2, axis=(0, 3))  # (F, K, m, 2), (1, m)
    share = np.sum(off * base, axis=(0, 3)) / np.maximum(size, np.finfo(float).tiny)  # (K, m)
    apart_from_base = off - share[None, :, :, None] * base
    freedom = (1 + 1 / K) / (K - 1)  # K placements about their mean, and the real one
    spread = np.sqrt(freedom * np.sum(share**2 * size) / max(np.sum(size), np.finfo(float).tiny))
    return Scatter(
        shared=spread * base[:, 0],
        correlation=_correlation(share, np.where(shown, np.sqrt(size[0]), 0.0)),
        rest=np.sqrt(freedom * _smoothed(np.sum(apart_from_base**2, axis=1))),
    )


def _correlation(share: np.ndarray, moves: np.ndarray) -> float:
    """Return the correlation of shares (K, m) between neighbours, 0 or more, weighted by how much both move (m,)."""
    grid, weight = share.reshape(-1, REGIONS, REGIONS), np.sqrt(moves.reshape(REGIONS, REGIONS))
    down, across = weight[1:] * weight[:-1], weight[:, 1:] * weight[:, :-1]
    pairs = [
        (grid[:, 1:] * down, grid[:, :-1] * down),
        (grid[:, :, 1:] * across, grid[:, :, :-1] * across),
    ]
    one, other = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    size = float(np.linalg.norm(one) * np.linalg.norm(other))
    return float(np.clip(one @ other / size, 0.0, 1.0)) if size > 0 else 0.0


def neighbours(correlation: float) -> np.ndarray:
    """Return a root (m, m) of the regions' correlation, which falls by a factor from each to the next along u and v."""
    away = np.abs(np.subtract.outer(np.arange(REGIONS), np.arange(REGIONS)))
    root = np.linalg.cholesky(np.clip(correlation, 0.0, 0.9) ** away)
    return np.kron(root, root)


def sorted_laws(model: FlowModel) -> list[str]:
    """Return the laws' directions in the order of Base.law."""
    keys = [key for key in model.motions[0].along if key.startswith("law ")]
    return sorted(keys, key=lambda key: (key.rsplit(" ", 1)[0], int(key.rsplit(" ", 1)[1])))


def _smoothed(square: np.ndarray) -> np.ndarray:
    """Return a square (F, m, 2) averaged over the 3 x 3 regions around each and both directions."""
    grid = square.mean(axis=-1).reshape(len(square), REGIONS, REGIONS)
    near = uniform_filter(grid, (0, 3, 3), mode="nearest")
    return np.repeat(near.reshape(len(square), -1, 1), 2, axis=-1)


def contact_points(
    problem: Problem, flow: pd.DataFrame, depths: tuple[np.ndarray, np.ndarray], slope: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return directions of the flow: (f, q) of an indentation's depth, in the last, and (f, S) of sessions' contact points.

    flow: labels of the f entries; depths: standard deviations (f,) [mm] of indentation and session; slope (f,) [px/mm]. The
    draws are those of the forces (readings_covariance).
    """
    by_press = np.zeros((len(flow), problem.covariance.levels[-3].directions.shape[1]))
    by_press[:, -1] = depths[0] * slope
    labels = problem.labels
    sessions = np.unique(labels["session"][problem.observations.session_depth_mm[labels["reading"]] > 0])
    return by_press, (flow["session"].to_numpy()[:, None] == sessions) * (depths[1] * slope)[:, None]


def _doubts(model: FlowModel) -> list[np.ndarray]:
    """Return changes of the flow (F, m, 2) by one standard deviation of what is not known: mesh, heights, blur, diameter.

    What no recording states of its particles' look is off by as much: blur by half a pixel, diameter by a fifth. By light,
    focus and cover the highest are seen by 0.3 more, and the lowest by as much less, than in a drawn image. Looks are drawn
    in three placements: their scatter is a part of a part.
    """
    few, eyes = model.particles.first(3), model.eyes
    blurred = [
        replace(eye, imaging=eye.imaging.model_copy(update={"blur_px": eye.imaging.blur_px + 0.5}))
        for eye in eyes
    ]
    larger = replace(few, diameter_mm=few.diameter_mm * 1.2)
    as_they_are = model.by_height(eyes, few)
    return [
        PART * model.change([one.coarse - one.even for one in model.motions]),
        model.other_heights(0.3),
        (model.by_height(blurred, few) - as_they_are).mean(axis=1),
        (model.by_height(eyes, larger) - as_they_are).mean(axis=1),
    ]
