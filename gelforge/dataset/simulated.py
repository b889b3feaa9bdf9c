"""Rows of a training set from one simulated indentation: solved, drawn with several particle patterns, reduced to features.

No image is written: each is drawn, reduced and forgotten.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gelforge.config import Camera, Study, VirtualImaging, given
from gelforge.dataset.shard import writing_shard
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.progress import tracked
from gelforge.recording.features import FlowFeatures
from gelforge.recording.imaging.flow import reduced
from gelforge.recording.optics.remap import scale_of_view
from gelforge.virtual_lab.drawn_indentations import DrawnIndentation, draw_indentation
from gelforge.virtual_lab.imaging import as_read, draw, expose, focused
from gelforge.virtual_lab.particles import interpolation, place_particles

SESSION = "simulated"


def synthesise(study: Study, laws: dict, number: int, out: str | Path) -> str:
    """Write the rows of one drawn indentation as a shard and return what became of it, in words.

    A row per step of its path and image series, and one untouched row per series. An indentation that does not converge
    leaves the rows of the steps that did, and its reason in the attribute `failed_cells`.
    """
    drawn = draw_indentation(study, number)
    cell = simulate_label(drawn.study, laws, {}, drawn.planned)
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    solved = len(cell.arrays["depth_mm"])
    attributes = _attributes(study, drawn, cell)
    patterns = given(study.synthesis, "synthesis").patterns if solved else 0
    with writing_shard(out, attributes, False, 2 * study.features.regions**2, bins) as writer:
        for series in tracked(range(patterns), "image series drawn"):
            writer.append(_rows(study, drawn, cell, series))
        rows = writer.rows
    reason = "" if cell.converged else f", ended early: {cell.attributes['reason']}"
    return f"{drawn.planned.name}: {drawn.study.indenter.words}, {solved} steps, {rows} rows{reason}"


def _attributes(study: Study, drawn: DrawnIndentation, cell: Cell) -> dict:
    synthesis, planned = given(study.synthesis, "synthesis"), drawn.planned
    name = planned.name
    view = {
        "image_px": [synthesis.camera.width_px, synthesis.camera.height_px],
        "crop_px": None,
        "camera": synthesis.camera.model_dump(mode="json"),
        **scale_of_view(study.features.image_scale),
    }
    about = {
        "orbit": name,
        "split": "train",
        "status": str(cell.attributes["status"]),
        "kind": drawn.kind,
        "indenter": drawn.study.indenter.words,
    }
    return {
        "study": study.study,
        "synthetic": True,
        "number": drawn.number,
        "cells": {name: about},
        "failed_cells": {} if cell.converged else {name: str(cell.attributes["reason"])},
        "sessions": {SESSION: {"synthetic": True, "view": view}},
    }


def _rows(study: Study, drawn: DrawnIndentation, cell: Cell, series: int) -> dict[str, np.ndarray]:
    """Return the rows of one image series: the untouched sensor, then each solved step."""
    planned, solved = drawn.planned, len(cell.arrays["depth_mm"])
    feature = np.stack(list(_features(study, drawn, cell, series)))
    bins, total = cell.arrays["bin_force_N"], cell.arrays["total_force_N"]
    label = np.concatenate([np.zeros_like(bins[:1]), bins])
    whole = np.concatenate([np.zeros((1, 3)), total])
    count = solved + 1
    steps = [f"{planned.name}_{step:02d}" for step in range(count)]
    return {
        "feature": feature,
        "force_distribution_N": label,
        "force_sigma_N": np.full_like(label, np.nan),
        "total_force_fem_N": whole,
        "total_force_fem_sigma_N": np.full((count, 3), np.nan),
        "total_force_ft_N": np.full((count, 3), np.nan),
        "flow_lost": np.zeros(count, np.float32),
        "position_mm": np.tile([planned.x_mm, planned.y_mm], (count, 1)),
        "depth_mm": np.concatenate([[0.0], cell.arrays["depth_mm"]]),
        "phase": np.array(["zero", *(planned.phases or ["load"] * solved)[:solved]], object),
        "cell": np.full(count, planned.name, object),
        "press": np.array(steps, object),
        "image_index": np.full(count, series, np.int32),
        "image": np.full(count, "", object),
        "session": np.full(count, SESSION, object),
        "split": np.full(count, "train", object),
        "untouched": np.arange(count) == 0,
    }


def _features(study: Study, drawn: DrawnIndentation, cell: Cell, series: int) -> Iterator[np.ndarray]:
    """Yield the features (2 m) of the untouched sensor and of each solved step, seen in one image series."""
    synthesis = given(study.synthesis, "synthesis")
    rng = np.random.default_rng([synthesis.seed, drawn.number, series])
    particles = place_particles(
        synthesis.particles, study.sensor, f"{synthesis.seed}-{drawn.number}-{series}"
    )
    weights = interpolation(cell.arrays["gel_node_mm"], cell.arrays["gel_hex"], particles)
    camera, imaging = _view(study, rng)
    imaging = focused(imaging, particles)
    diameter = synthesis.particles.diameter_mm

    def seen(moved: np.ndarray) -> np.ndarray:
        image = expose(draw(camera, imaging, particles + moved, diameter), imaging, rng)
        return reduced(image, study.features.image_scale)

    extract = FlowFeatures(seen(np.zeros(3)), study.features)
    yield extract(seen(np.zeros(3)))
    for displacement in cell.arrays["gel_displacement_mm"]:
        yield extract(seen(weights @ displacement.astype(float)))


def _view(study: Study, rng: np.random.Generator) -> tuple[Camera, VirtualImaging]:
    """Return camera and imaging of one image series, drawn about the study's."""
    synthesis = given(study.synthesis, "synthesis")
    views, camera, imaging = synthesis.views, synthesis.camera, as_read(synthesis.imaging)
    away = {
        "focal_px": given(camera.focal_px, "synthesis.camera.focal_px")
        * (1 + views.focal_share * rng.standard_normal()),
        "centre_px": list(np.add(camera.centre_px, views.centre_px * rng.standard_normal(2))),
        "rotation_deg": list(np.add(camera.rotation_deg, views.rotation_deg * rng.standard_normal(3))),
    }
    light = max(1 + views.brightness_share * rng.standard_normal(), 0.2)
    drawn = {
        "background_grey": min(light * imaging.background_grey, 255.0),
        "particle_grey": min(light * imaging.particle_grey, 255.0),
        "blur_px": imaging.blur_px * max(1 + views.blur_share * rng.standard_normal(), 0.0),
        "noise_grey": imaging.noise_grey * max(1 + views.noise_share * rng.standard_normal(), 0.0),
    }
    return camera.model_copy(update=away), imaging.model_copy(update=drawn)
