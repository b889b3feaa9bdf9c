"""A session's feature file: its checks, and the rows of each indentation's images in it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from gelforge.config import Study
from gelforge.dataset.schema import DatasetError
from gelforge.hdf5 import opened
from gelforge.indentation.paths.places import DEPTH_MATCH_MM, gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell

FEATURE_FORMAT = "gelforge-features-1"


@dataclass
class PressRows:
    """Where one indentation's images lie in a session's feature file, in the order of their index."""

    cell: str
    depth_mm: float
    step: list[int] = field(default_factory=list)  # of the site's path, -1 of none
    row: list[int] = field(default_factory=list)
    image_index: list[int] = field(default_factory=list)
    untouched: list[bool] = field(default_factory=list)


def open_features(path: str | Path) -> h5py.File:
    """Return a session's features, opened after checking that they are whole.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    h5py.File
        Open for reading.

    Raises
    ------
    DatasetError
        For a file that is missing, damaged or of another format.
    """
    remedy = f"extract the features again (snakemake -R {path})"
    return opened(path, FEATURE_FORMAT, remedy, DatasetError)


def check_features(path: str | Path, session: str, study: Study, expected: str | None) -> None:
    with open_features(path) as file:
        if expected is not None and file.attrs["digest"] != expected:
            raise DatasetError(
                f"{path}: session {session} was made with other settings, tables or images than those there now (digest "
                f"{str(file.attrs['digest'])[:12]}, expected {expected[:12]}); extract the features again "
                f"(snakemake -R {path})"
            )
        width = file["feature"].shape[1]
        if width != 2 * study.features.regions**2:
            raise DatasetError(
                f"{path}: {width} features a row, expected {2 * study.features.regions**2} for features.regions "
                f"{study.features.regions}; extract the features again"
            )


def session_attributes(path: str | Path) -> dict:
    with open_features(path) as file:
        return {
            "features": Path(path).as_posix(),
            "features_digest": str(file.attrs["digest"]),
            "synthetic": bool(file.attrs["synthetic"]),
            "view": json.loads(file.attrs.get("view", "null")),
        }


def rows_of_presses(
    path: str | Path, planned: Mapping[str, PlannedCell], chunk: set[str]
) -> dict[str, PressRows]:
    """Return the indentations of a chunk's sites, every image of theirs in its place.

    The number of images of a touching indentation is what most indentations of the session have; a path has as many as its
    steps.
    """
    presses: dict[str, PressRows] = {}
    touching: Counter[str] = Counter()  # images per straight indentation, of the whole session
    following: set[str] = set()  # indentations that follow a path
    for row, press, cell, phase, image, index, depth, xy, step in _scan(path):
        if cell not in planned:
            raise DatasetError(
                f"{path}: indentation {press}, image {image}: its site {cell!r} is not in the plan; "
                "join the recording to the plan again"
            )
        _check_place(path, press, planned[cell], phase, xy)
        if planned[cell].follows_a_path:
            following.add(press)
            if phase != "zero":
                _check_pose(path, press, image, planned[cell], step, np.array([depth, *xy]))
        else:
            touching[press] += phase != "zero"
        if cell not in chunk:
            continue
        rows = presses.setdefault(press, PressRows(cell, 0.0))
        if rows.cell != cell:
            raise DatasetError(
                f"{path}: indentation {press} has images of sites {rows.cell!r} and {cell!r}; give each indentation its own"
                " name"
            )
        rows.row.append(row)
        rows.step.append(int(step))
        rows.image_index.append(int(index))
        rows.untouched.append(phase == "zero")
        rows.depth_mm = max(rows.depth_mm, float(depth))
    for press, count in _excluded_images(path).items():
        if press not in following:
            touching[press] += count
    usual = Counter(touching.values()).most_common(1)[0][0] if touching else 0
    for press, rows in presses.items():
        _check_images(path, press, rows, usual if press in following else touching[press], usual)
    return presses


def _scan(path: str | Path) -> Iterator[tuple[int, str, str, str, str, int, float, np.ndarray, int]]:
    """Yield row, press, cell, phase, image, image_index, depth, position (2,) and step of a feature file."""
    with open_features(path) as file:
        read = 4096  # rows in memory at a time
        for start in range(0, len(file["press"]), read):
            block = slice(start, start + read)
            texts = [file[name].asstr()[block] for name in ("press", "cell", "phase", "image")]
            numbers = [file[name][block] for name in ("image_index", "depth_mm", "position_mm")]
            steps = file["step"][block] if "step" in file else np.full(len(numbers[0]), -1)
            for i, values in enumerate(zip(*texts, *numbers, steps)):
                yield start + i, *values


def _check_place(path: str | Path, press: str, planned: PlannedCell, phase: str, xy: np.ndarray) -> None:
    """Raise DatasetError for a reading far from its site, which may have moved since the recording was joined to the plan.

    The first reading at depth lies within the site's tolerance, the others of its indentation within it of that one.
    """
    gap, limit = gaps_to((planned.x_mm, planned.y_mm), xy)[0], 2 * planned.within_mm
    if phase in ("zero", "load", "dwell") and not (planned.shears_mm or within(gap, limit)):
        raise DatasetError(
            f"{path}: indentation {press} at ({xy[0]:.4f}, {xy[1]:.4f}) mm is {gap:.3g} mm from site {planned.name}, limit"
            f" {limit:g} mm: the plan has changed; extract the features again (snakemake -R {path})"
        )


def _check_pose(
    path: str | Path, press: str, image: str, planned: PlannedCell, step: int, pose: np.ndarray
) -> None:
    """Raise DatasetError unless an image (depth, x, y) was taken at the step of its site's path that the features state."""
    where = f"{path}: indentation {press}, image {image}: depth {pose[0]:g} mm at ({pose[1]:.4f}, {pose[2]:.4f}) mm"
    if 0 <= step < len(planned.depths_mm):
        shear = planned.shears_mm[step] if planned.shears_mm else (0.0, 0.0)
        there = planned.x_mm + shear[0], planned.y_mm + shear[1]
        deep = within(abs(planned.depths_mm[step] - pose[0]), DEPTH_MATCH_MM)
        if deep and within(gaps_to(pose[1:], there)[0], planned.within_mm):
            return
    raise DatasetError(
        f"{where} is not at step {step} of the path of site {planned.name}; extract the features again (snakemake -R {path})"
    )


def _excluded_images(path: str | Path) -> dict[str, int]:
    """Return by press how many of its images at depth were excluded before their features were extracted."""
    with open_features(path) as file:
        return json.loads(file.attrs.get("excluded_images", "{}"))


def _check_images(path: str | Path, press: str, rows: PressRows, count: int, usual: int) -> None:
    gaps = sorted(set(range(len(rows.row))) - set(rows.image_index))
    if gaps or count != usual:
        what = f"{count} images at depth, {usual} in most indentations"
        if gaps:
            what = f"image_index {gaps} missing"
        raise DatasetError(
            f"{path}: indentation {press} of site {rows.cell}: {what}; restore its images and extract the features again, "
            "or remove the indentation from indentations.csv"
        )
    order = np.argsort(rows.image_index)
    rows.row, rows.image_index, rows.untouched, rows.step = (
        [values[i] for i in order] for values in (rows.row, rows.image_index, rows.untouched, rows.step)
    )


def rows_of(data, rows: list[int]) -> np.ndarray:
    """Return rows of an HDF5 dataset in the order given; HDF5 itself reads in increasing order only."""
    order = np.argsort(rows)
    values = data[np.asarray(rows)[order]]
    placed = np.empty_like(values)
    placed[order] = values
    return placed
