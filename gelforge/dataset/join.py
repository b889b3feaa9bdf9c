"""Labels of simulated sites and features of recorded images, joined row by row into one shard."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np

from gelforge.config import Study
from gelforge.dataset.feature_rows import (
    PressRows,
    check_features,
    open_features,
    rows_of,
    rows_of_presses,
    session_attributes,
)
from gelforge.dataset.schema import DatasetError
from gelforge.dataset.session_labels import (
    Label,
    OwnCells,
    OwnPresses,
    cell_label,
    check_closure,
    check_digest,
    sigma,
)
from gelforge.dataset.shard import writing_shard
from gelforge.dataset.splits import planned_split
from gelforge.files import digest, file_sha256
from gelforge.indentation.cells.cell_file import ERROR_BARS, Cell, read_cell
from gelforge.indentation.paths.places import DEPTH_MATCH_MM, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.progress import tracked

# The label of an indentation at a depth step of its site, or why it has none.
Labels = Callable[[str, int], "Label | str"]


def join_shard(
    study: Study,
    cells_of_chunk: Sequence[str],
    cell_files: Mapping[str, str | Path],
    feature_files: Mapping[str, str | Path],
    out: str | Path,
    cell_digests: Mapping[str, str] | None = None,
    feature_digests: Mapping[str, str] | None = None,
    own_labels: Mapping[str, OwnCells | OwnPresses] | None = None,
) -> int:
    """Write the shard of some planned sites and return its number of rows.

    Rows follow the sites as given, then sessions and indentations in the order recorded, then images. Memory holds the rows
    of one site. A failed site is left out and listed with its reason in the attribute `failed_cells`; what is a session's
    own in its attributes `failed_cells` and `failed_presses`.

    Parameters
    ----------
    study : Study
        Its plan names the sites.
    cells_of_chunk : sequence of str
        Sites of the shard.
    cell_files : mapping of str to str or Path
        The file of each of these sites.
    feature_files : mapping of str to str or Path
        By session, the features of those with images; empty for a shard of labels only (one row per site and depth).
    out : str or Path
        The shard.
    cell_digests : mapping of str to str, optional
        By site, what its `inputs_digest` must be under the study's present settings.
    feature_digests : mapping of str to str, optional
        By session, what the `digest` of its features must be under the study's present settings.
    own_labels : mapping of str to OwnCells or OwnPresses, optional
        By session, labels other than those of the plan's sites. The sensor had another age or temperature there, or
        remembers earlier indentations.

    Returns
    -------
    int
        Rows written.

    Raises
    ------
    DatasetError
        For a site that is not in the plan, and for labels, features or images that are missing or of other settings.
    CellError
        For a site that is missing, truncated or from other settings.
    """
    planned = plan_cells(study)
    unknown = [name for name in cells_of_chunk if name not in planned]
    if unknown:
        raise DatasetError(
            f"sites {unknown} are not in the plan of study {study.study}; join the study's own sites"
        )
    split, orbit = planned_split(planned, study.sensor, study.dataset.test_fraction, study.seed)
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    labels_only = not feature_files
    attributes = _shard_attributes(study, {name: split[name] for name in cells_of_chunk})
    sessions, own_labels = {}, own_labels or {}
    for session, path in feature_files.items():
        check_features(path, session, study, (feature_digests or {}).get(session))
        sessions[session] = rows_of_presses(path, planned, set(cells_of_chunk))
        attributes["sessions"][session] = session_attributes(path)
        of_session = own_labels.get(session)
        if isinstance(of_session, OwnPresses) and sessions[session]:
            attributes["sessions"][session]["presses"] = _presses_attributes(of_session)
    attributes["synthetic"] = any(s["synthetic"] for s in attributes["sessions"].values())

    with writing_shard(out, attributes, labels_only, 2 * study.features.regions**2, bins) as writer:
        for name in tracked(cells_of_chunk, "sites joined"):
            path = cell_files[name]
            cell = _checked_cell(path, planned[name], bins, (cell_digests or {}).get(name))
            attributes["cells"][name] = _cell_attributes(path, cell, planned[name], split[name]) | {
                "orbit": orbit[name],
                "indenter": study.indenter.words,
            }
            if not cell.converged:
                attributes["failed_cells"][name] = str(cell.attributes["reason"])
            elif labels_only:
                writer.append(_label_rows(cell, planned[name], split[name]))
            blocks = []
            for session in sorted(sessions):
                pressed = {p: rows for p, rows in sessions[session].items() if rows.cell == name}
                about = attributes["sessions"][session]
                labels = pressed and _labels(
                    own_labels.get(session), planned[name], cell, bins, about, split[name]
                )
                if labels:
                    blocks += _session_rows(
                        feature_files[session], session, pressed, planned[name], labels, about, split[name]
                    )
            if blocks:
                writer.append({column: np.concatenate([b[column] for b in blocks]) for column in blocks[0]})
        return writer.rows


# -------------------------------------------------------------------------------------------------- sites
def _checked_cell(path: str | Path, planned: PlannedCell, bins: int, expected: str | None) -> Cell:
    """Return a site's label arrays after checking that they belong to the plan and to the present settings."""
    cell = read_cell(path, ["depth_mm", "total_force_N", "bin_force_N"], ERROR_BARS)
    attributes = cell.attributes
    check_digest(path, planned.name, cell, expected)
    gap = max(abs(attributes["x_mm"] - planned.x_mm), abs(attributes["y_mm"] - planned.y_mm))
    if gap > 1e-6:  # the plan is rounded to 1e-6 mm
        raise DatasetError(
            f"{path}: site {planned.name} lies at ({attributes['x_mm']}, {attributes['y_mm']}) mm, the plan has "
            f"({planned.x_mm}, {planned.y_mm}) mm; simulate it again"
        )
    if cell.converged:
        _check_label(path, cell, planned, bins)
    return cell


def _check_label(path: str | Path, cell: Cell, planned: PlannedCell, bins: int) -> None:
    depths, total, label = (cell.arrays[name] for name in ("depth_mm", "total_force_N", "bin_force_N"))
    if len(depths) != len(planned.depths_mm) or np.abs(depths - planned.depths_mm).max() > 1e-6:
        raise DatasetError(
            f"{path}: site {planned.name} has depths {depths.tolist()} mm, the plan "
            f"{list(planned.depths_mm)}; simulate it again"
        )
    if label.shape != (len(depths), bins, 3):
        raise DatasetError(
            f"{path}: bin_force_N has shape {label.shape}, expected {(len(depths), bins, 3)}; simulate the site again"
        )
    check_closure(path, f"site {planned.name}", total, label)
    for name in sorted(ERROR_BARS & set(cell.arrays)):
        if not (cell.arrays[name] >= 0).all():  # also refuses what is not a number
            raise DatasetError(
                f"{path}: site {planned.name}: {name} holds values that are no standard deviations; simulate it again"
                f" (snakemake -R {path})"
            )


def _cell_attributes(path: str | Path, cell: Cell, planned: PlannedCell, split: str) -> dict:
    between = {
        name: [str(site) for site in np.atleast_1d(cell.attributes[name])]
        for name in ("interpolated_from", "solved_as")
        if name in cell.attributes
    }
    return between | {
        "file": Path(path).as_posix(),
        "sha256": file_sha256(path),
        "inputs_digest": str(cell.attributes["inputs_digest"]),
        "code_version": str(cell.attributes.get("code_version", "")),
        "status": str(cell.attributes["status"]),
        "split": split,
        "mirrors": planned.source,
        "symmetry": planned.symmetry,
    }


def _labels(
    stored: OwnCells | OwnPresses | None, planned: PlannedCell, cell: Cell, bins: int, about: dict, split: str
) -> Labels | None:
    """Return where a session's indentations of a site have their labels from, None where the site failed.

    about: the session's attributes; its own site and the failure of that are added.
    """
    if isinstance(stored, OwnPresses):
        return lambda press, step: stored.label(press)
    if stored:
        path = stored.files[planned.name]
        cell = _checked_cell(path, planned, bins, stored.digests.get(planned.name))
        about.setdefault("cells", {})[planned.name] = _cell_attributes(path, cell, planned, split)
        if not cell.converged:
            about.setdefault("failed_cells", {})[planned.name] = str(cell.attributes["reason"])
    return (lambda press, step: cell_label(cell, step)) if cell.converged else None


def _presses_attributes(labels: OwnPresses) -> dict:
    return {
        "file": labels.path.as_posix(),
        "sha256": file_sha256(labels.path),
        **{name: str(labels.attributes[name]) for name in ("inputs_digest", "code_version", "status")},
    }


def _site_rows(planned: PlannedCell, split: str, steps: Sequence[int], untouched) -> dict[str, np.ndarray]:
    """Return what rows at steps (n,) of a site's path have in common; untouched (n,): those before contact."""
    count, untouched = len(steps), np.array(untouched)
    phases = np.array(planned.phases or ["load"] * len(planned.depths_mm))[steps]
    return {
        "position_mm": np.tile([planned.x_mm, planned.y_mm], (count, 1)),
        "depth_mm": ~untouched * np.array(planned.depths_mm)[steps],
        "phase": np.where(untouched, "zero", phases).astype(object),
        "cell": np.full(count, planned.name, object),
        "split": np.full(count, split, object),
        "untouched": untouched,
    }


def _label_rows(cell: Cell, planned: PlannedCell, split: str) -> dict[str, np.ndarray]:
    count = len(planned.depths_mm)
    return _site_rows(planned, split, range(count), [False] * count) | {
        "force_distribution_N": cell.arrays["bin_force_N"],
        "force_sigma_N": sigma(cell, "bin"),
        "total_force_fem_N": cell.arrays["total_force_N"],
        "total_force_fem_sigma_N": sigma(cell, "total"),
    }


# ------------------------------------------------------------------------------------------------- images
def _session_rows(
    path: str | Path,
    session: str,
    pressed: Mapping[str, PressRows],
    planned: PlannedCell,
    labels: Labels,
    about: dict,
    split: str,
) -> list[dict[str, np.ndarray]]:
    """Return the rows of a session's indentations at one site, a block for each; one without label is noted in about."""
    blocks = []
    with open_features(path) as file:
        for press, rows in pressed.items():
            steps = _steps(path, press, rows, planned)
            labels_of = {step: labels(press, step) for step in sorted(set(steps))}
            reason = next((label for label in labels_of.values() if isinstance(label, str)), "")
            if reason:
                about.setdefault("failed_presses", {})[press] = reason
            else:
                known = {step: label for step, label in labels_of.items() if not isinstance(label, str)}
                of_row = [known[step] for step in steps]
                block = _image_rows(file, f"{path}: indentation {press}", rows, of_row)
                block["press"], block["session"] = (np.full(len(steps), n, object) for n in (press, session))
                blocks.append(block | _site_rows(planned, split, steps, rows.untouched))
    return blocks


def _steps(path: str | Path, press: str, rows: PressRows, planned: PlannedCell) -> list[int]:
    """Return for each image of an indentation at which of its site's depths, or steps of its path, it was taken."""
    if planned.follows_a_path:
        return [max(step, 0) for step in rows.step]  # untouched rows have no step, and no use for one
    step = int(np.argmin(np.abs(np.array(planned.depths_mm) - rows.depth_mm)))
    gap = abs(planned.depths_mm[step] - rows.depth_mm)
    if not within(gap, DEPTH_MATCH_MM) and not all(rows.untouched):
        raise DatasetError(
            f"{path}: indentation {press}: depth {rows.depth_mm} mm is {gap:.3g} mm from the nearest depth of site"
            f" {planned.name} ({planned.depths_mm[step]} mm), limit {DEPTH_MATCH_MM} mm; add the depth to the plan"
        )
    return [step] * len(rows.row)


def _image_rows(
    file: h5py.File, where: str, rows: PressRows, labels: Sequence[Label]
) -> dict[str, np.ndarray]:
    """Return what is of an indentation's images: features, readings, and labels, zero where the ball had not touched.

    where: file and indentation, for messages.
    """
    feature, image = rows_of(file["feature"], rows.row), rows_of(file["image"].asstr(), rows.row)
    bad = ~np.isfinite(feature).all(axis=1)
    if bad.any():
        raise DatasetError(
            f"{where}, image {image[bad.argmax()]}: features are not finite; extract the features again"
        )

    def labelled(name: str) -> np.ndarray:
        values = np.stack([getattr(label, name) for label in labels])
        return np.where(np.reshape(rows.untouched, (-1, *[1] * (values.ndim - 1))), 0.0, values)

    return {
        "feature": feature,
        "force_distribution_N": labelled("bins"),
        "force_sigma_N": labelled("bin_sigma"),
        "total_force_fem_N": labelled("total"),
        "total_force_fem_sigma_N": labelled("total_sigma"),
        "total_force_ft_N": rows_of(file["force_N"], rows.row),
        "flow_lost": rows_of(file["flow_lost"], rows.row),
        "image_index": np.array(rows.image_index, np.int32),
        "image": image,
    }


# --------------------------------------------------------------------------------------------- attributes
def shard_settings_digest(study: Study) -> str:
    """Return the digest of what decides a shard in addition to its sites and features: settings, and the split of all sites.

    A site that is added to a plan file or a session may move others from one side of the split to the other.
    """
    names = {"seed", "dataset", "plan", "sensor", "features"}
    split, _ = planned_split(plan_cells(study), study.sensor, study.dataset.test_fraction, study.seed)
    return digest([study.model_dump(mode="json", include=names), split])


def _shard_attributes(study: Study, split: Mapping[str, str]) -> dict:
    return {
        "study": study.study,
        "split_seed": study.seed,
        "test_fraction": study.dataset.test_fraction,
        "settings_digest": shard_settings_digest(study),
        "train_cells": sum(value == "train" for value in split.values()),
        "test_cells": sum(value == "test" for value in split.values()),
        "cells": {},
        "failed_cells": {},
        "sessions": {},
    }
