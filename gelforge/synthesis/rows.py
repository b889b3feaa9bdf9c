"""Training rows of a simulated sensor: presses between and from solved ones, with features of drawn images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gelforge.config import Study, given
from gelforge.dataset.shard import writing_shard
from gelforge.indentation.cells.cell_file import Cell, read_cell
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.interpolation.nodal_forces import NodalForces
from gelforge.progress import tracked
from gelforge.recording.optics.remap import scale_of_view
from gelforge.synthesis import SESSION
from gelforge.synthesis.drawn_press import DrawnPress
from gelforge.synthesis.draws import Solution, drawn_path, path_number, site_places
from gelforge.synthesis.images import series_features
from gelforge.synthesis.moved import MovedPresses
from gelforge.synthesis.straight import StraightPresses
from gelforge.virtual_lab.particles import VirtualLabError, interpolation

# Presses of one image series; each series has particles, camera and light of its own.
# benchmarks/transfer.py prints what networks trained on such series err by.
SERIES_ROWS = 16


def solve(one: Solution, laws: dict) -> Cell:
    """Return an indentation of the synthesis, solved on the mesh of labels, with the gel's displacement and without error
    bars.

    Parameters
    ----------
    one : Solution
        As `solution` returns it.
    laws : dict of str to PrincipalLaw
        By material [MPa].

    Returns
    -------
    Cell
        Forces [N] and displacements [mm]; `converged` is False where a depth was not reached.
    """
    return simulate_cell(one.study, laws, one.planned)


def write_rows(study: Study, number: int, solutions: Sequence[str | Path], out: str | Path) -> str:
    """Write the training rows of one shard, drawn from solutions, and return what was done, in words.

    Parameters
    ----------
    study : Study
        A study with `synthesis`.
    number : int
        Of the shard, from 0; the same number gives the same rows.
    solutions : sequence of path
        Files of the solved presses in their order: sites, then paths.
    out : path
        HDF5 file to write: a shard whose sites are the image series.

    Returns
    -------
    str
        Numbers of rows, image series and solved presses.

    Raises
    ------
    VirtualLabError
        If a site ended early, or no path has a solved step.
    """
    synthesis = given(study.synthesis, "synthesis")
    first = number * synthesis.rows_per_shard
    count = min(synthesis.rows_per_shard, synthesis.rows - first)
    source = Presses(study, [read_cell(path) for path in solutions])
    rng = np.random.default_rng([synthesis.seed, 1, number])
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    series = math.ceil(count / (SERIES_ROWS + 1))  # one row of each shows the untouched sensor
    names = [f"rows{number:05d}_{k:04d}" for k in range(series)]
    about = {
        name: {"orbit": name, "split": "train", "status": "converged", "kind": "drawn"} for name in names
    }
    attributes = _attributes(study, about)
    with writing_shard(out, attributes, False, 2 * study.features.regions**2, bins) as writer:
        for name in tracked(names, "image series drawn"):
            presses = [source.draw(rng) for _ in range(min(SERIES_ROWS, count - writer.rows - 1))]
            writer.append(_block(study, name, presses, 0))
        rows = writer.rows
    return f"{rows} rows of {series} image series from {len(solutions)} solved presses"


class Presses:
    """Where training rows are drawn from: straight presses between sites, and steps of paths."""

    def __init__(self, study: Study, cells: Sequence[Cell]):
        synthesis = given(study.synthesis, "synthesis")
        count = len(site_places(study))
        sites, paths = cells[:count], cells[count:]
        for cell in sites:
            if not cell.converged:
                raise VirtualLabError(
                    f"site {cell.attributes['cell']} at ({cell.attributes['x_mm']:g}, {cell.attributes['y_mm']:g}) mm ended "
                    f"early: {cell.attributes['reason']}; make synthesis.depth_mm smaller or synthesis.margin_mm larger"
                )
        self.straight = StraightPresses(study, sites) if sites else None
        numbers = [path_number(cell.attributes["cell"]) for cell in paths]
        by_own_indenter = [drawn_path(study, number).kind == "own" for number in numbers]
        self.moved = MovedPresses(study, paths, by_own_indenter, self.straight)
        classes = synthesis.classes
        if classes.paths and not self.moved.cells:
            raise VirtualLabError(
                f"none of {len(paths)} paths has a solved step; make synthesis.depth_mm smaller, or set "
                "synthesis.classes.paths: 0"
            )
        weights = np.array([classes.straight, classes.light, classes.paths])
        self._share = weights / weights.sum()

    def draw(self, rng: np.random.Generator) -> DrawnPress:
        """Return a drawn press of a drawn class."""
        kind = int(rng.choice(3, p=self._share))
        if kind == 2 or self.straight is None:
            return self.moved.draw(rng)
        least, deepest = self.straight.depths[1], self.straight.depths[-1]
        if kind == 0:
            depth = rng.uniform(least, deepest)
        else:  # light presses, up to a fifth of the deepest depth, are drawn evenly over magnitudes
            depth = np.exp(rng.uniform(*np.log([least, 0.2 * deepest])))
        return self.straight.at(rng.uniform(self.straight.low, self.straight.high), float(depth))


def write_solved(
    study: Study, one: Solution, cell: Cell, out: str | Path, seed: int, series: int = 1
) -> None:
    """Write rows of one solved press as they are, every step in each image series: for tests of networks."""
    name = one.planned.name
    about = {"orbit": name, "split": "train", "status": str(cell.attributes["status"]), "kind": one.kind}
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    place = np.array([one.planned.x_mm, one.planned.y_mm])
    phases = list(one.planned.phases or ["load"] * len(one.planned.depths_mm))

    def moved(step: int):
        def at(particles: np.ndarray) -> np.ndarray:
            weights = interpolation(cell.arrays["gel_node_mm"], cell.arrays["gel_hex"], particles)
            return weights @ cell.arrays["gel_displacement_mm"][step].astype(float)

        return at

    forces = NodalForces.of(cell)
    presses = [
        DrawnPress(place, float(depth), phases[k], replace(forces, force_N=forces.force_N[[k]]), moved(k))
        for k, depth in enumerate(cell.arrays["depth_mm"])
    ]
    attributes = _attributes(study, {name: about | {"indenter": one.study.indenter.words}})
    with writing_shard(out, attributes, False, 2 * study.features.regions**2, bins) as writer:
        for number in range(series):
            writer.append(_block(study, name, presses, number, f"{seed}-{name}-{number}"))


def _attributes(study: Study, cells: dict) -> dict:
    camera = given(study.synthesis, "synthesis").camera
    view = {
        "image_px": [camera.width_px, camera.height_px],
        "crop_px": None,
        "camera": camera.model_dump(mode="json"),
        **scale_of_view(study.features.image_scale),
    }
    return {
        "study": study.study,
        "synthetic": True,
        "cells": cells,
        "failed_cells": {},
        "sessions": {SESSION: {"synthetic": True, "view": view}},
    }


def _block(study: Study, name: str, presses: Sequence[DrawnPress], series: int, serial: str = "") -> dict:
    """Return the rows of one image series: the untouched sensor, then each press."""
    seed = given(study.synthesis, "synthesis").seed
    serial = serial or f"{seed}-{name}-{series}"
    rng = np.random.default_rng(list(serial.encode()))
    feature = np.stack(list(series_features(study, presses, serial, rng)))
    bins = np.zeros((len(presses) + 1, study.sensor.bins.nx * study.sensor.bins.ny, 3))
    for k, press in enumerate(presses):
        bins[k + 1] = press.bins(study.sensor)
    count, total = len(bins), bins.sum(axis=1)
    middle = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm]) / 2
    return {
        "feature": feature,
        "force_distribution_N": bins,
        "force_sigma_N": np.full_like(bins, np.nan),
        "total_force_fem_N": total,
        "total_force_fem_sigma_N": np.full((count, 3), np.nan),
        "total_force_ft_N": np.full((count, 3), np.nan),
        "flow_lost": np.zeros(count, np.float32),
        "position_mm": np.array(
            [presses[0].place if presses else middle, *(press.place for press in presses)]
        ),
        "depth_mm": np.array([0.0, *(press.depth_mm for press in presses)]),
        "phase": np.array(["zero", *(press.phase for press in presses)], object),
        "cell": np.full(count, name, object),
        "press": np.array([f"{name}_{k:03d}" for k in range(count)], object),
        "image_index": np.full(count, series, np.int32),
        "image": np.full(count, "", object),
        "session": np.full(count, SESSION, object),
        "split": np.full(count, "train", object),
        "untouched": np.arange(count) == 0,
    }
