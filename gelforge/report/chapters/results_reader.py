"""What a finished study left in its results folder, read for the report; nothing is recomputed."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from gelforge.config import ConfigError, Session, Study, load_session
from gelforge.dataset.agreement import read_agreement
from gelforge.dataset.feature_rows import open_features
from gelforge.dataset.manifest import read_manifest
from gelforge.files import read_product_table
from gelforge.hdf5 import opened
from gelforge.indentation.cells.cell_file import Cell, CellError, read_cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import CORNER_MM, landmarks, plan_cells
from gelforge.materials.fitting.law_file import MaterialLaw, read_law
from gelforge.recording.plausibility.findings import read_findings
from gelforge.report.figures.neighbours import CURVE_SITES, nearest, one_depth_each

SIGMAS = {"mesh": "total_sigma_mesh_N", "constitutive models": "total_sigma_material_N"}


@dataclass(frozen=True)
class StudyResults:
    """The files of one study, read when asked for; what is not there is None or empty."""

    study: Study
    folder: Path
    paper_folder: Path | None  # the article's numbers, of its own study

    @cached_property
    def planned(self) -> dict[str, PlannedCell]:
        return plan_cells(self.study)

    @cached_property
    def cell_attributes(self) -> dict[str, dict]:
        """Attributes of each planned site; an absent or unreadable file has status "missing" and a reason."""
        attributes = {}
        for name in self.planned:
            try:
                attributes[name] = read_cell(self.cell_path(name), arrays=[]).attributes
            except CellError as error:
                attributes[name] = {"status": "missing", "reason": str(error), "last_good_depth_mm": np.nan}
        return attributes

    def cell_path(self, name: str) -> Path:
        return self.folder / "cells" / f"{name}.h5"

    def cell(self, name: str) -> Cell:
        return read_cell(self.cell_path(name))

    def converged(self) -> list[PlannedCell]:
        return [c for name, c in self.planned.items() if self.cell_attributes[name]["status"] == "converged"]

    def not_converged(self) -> list[PlannedCell]:
        return [c for name, c in self.planned.items() if self.cell_attributes[name]["status"] != "converged"]

    @property
    def widths_mm(self) -> tuple[float, float]:
        return self.study.sensor.width_x_mm, self.study.sensor.width_y_mm

    @property
    def centre_mm(self) -> np.ndarray:
        return np.array(self.widths_mm) / 2

    def sites_at(self, landmark: str) -> tuple[list[PlannedCell], str]:
        """Return the converged sites that make a curve over depth at the "centre" or "corner", and where they are in words.

        This is the site at the place; at the corner one that is 5 mm from two edges, that of large x and y first. Where the
        sites have one depth each it is the CURVE_SITES nearest to the place. No site: the plan has none there.
        """
        cells = self.converged()
        if not self.has_one_depth_each:
            there = landmarks({cell.name: cell for cell in cells}, self.study).get(landmark)
            return ([there], f"({there.x_mm:g}, {there.y_mm:g}) mm") if there else ([], "")
        place = self.centre_mm if landmark == "centre" else np.array(self.widths_mm) - CORNER_MM
        chosen, distance = nearest(np.array([(c.x_mm, c.y_mm) for c in cells]), place, CURVE_SITES)
        where = f"up to {distance:.2g} mm from ({place[0]:g}, {place[1]:g}) mm"
        return [cells[k] for k in chosen], f"{len(chosen)} sites {where}"

    @cached_property
    def has_one_depth_each(self) -> bool:
        rows = [(cell.name, depth) for cell in self.converged() for depth in cell.depths_mm]
        table = pd.DataFrame(rows, columns=["site", "depth"])
        return one_depth_each(table["site"], table["depth"])

    @cached_property
    def label_errors(self) -> pd.DataFrame:
        """cell, depth, force and its standard deviations by part [N] (vertical) of each solved site's loading.

        Without rows where no site holds any error bar.
        """
        solved = [cell for cell in self.converged() if not cell.source]
        columns = ["cell", "depth", "force", *SIGMAS]
        return pd.DataFrame([row for cell in solved for row in self._errors(cell)], columns=columns)

    def _errors(self, planned: PlannedCell) -> list[tuple]:
        cell = read_cell(self.cell_path(planned.name), ["depth_mm", "total_force_N"], SIGMAS.values())
        if not set(SIGMAS.values()) <= set(cell.arrays):
            return []
        phases = planned.phases or ("load",) * len(cell.arrays["depth_mm"])
        parts = [cell.arrays[key][:, 2].astype(float) for key in SIGMAS.values()]
        depth, force = cell.arrays["depth_mm"], -cell.arrays["total_force_N"][:, 2].astype(float)
        return [
            (planned.name, round(float(depth[k]), 6), force[k], *(part[k] for part in parts))
            for k, phase in enumerate(phases)
            if phase == "load"  # a force that has all but gone has no relative error
        ]

    def variant_cell(self, variant: str, name: str) -> Cell | None:
        """Return a site as a variant of the study has it, or None where it is not there or has not converged."""
        try:
            cell = read_cell(self.folder / "variants" / variant / f"{name}.h5")
        except CellError:
            return None
        return cell if cell.converged else None

    @cached_property
    def sessions(self) -> dict[str, Session]:
        """Descriptions of the recorded sessions whose session.yaml can be read."""
        by_name = {}
        for name in self.study.sessions:
            try:
                by_name[name] = load_session(self.study.session_folder(name) / "session.yaml")
            except ConfigError:
                continue
        return by_name

    @property
    def resolution_N(self) -> list[float]:
        """Return the coarsest resolution [N] of x, y, z among the sessions."""
        values = [s.force.resolution_N for s in self.sessions.values()] or [[0.03, 0.03, 0.06]]
        return [max(column) for column in zip(*values)]

    @property
    def synthetic_parts(self) -> list[str]:
        """Return what a virtual lab made: "recordings", "material tests", both or none."""
        lab = self.study.virtual_lab is not None and bool(self.study.sessions)
        recordings = lab or any(session.synthetic for session in self.sessions.values())
        tests = any(law.synthetic for law in self.laws.values())
        return ["recordings"] * recordings + ["material tests"] * tests

    @cached_property
    def laws(self) -> dict[str, MaterialLaw]:
        """Laws of the materials whose law.json is there."""
        paths = {name: self.folder / "materials" / name / "law.json" for name in self.study.materials}
        return {name: read_law(path) for name, path in paths.items() if path.is_file()}

    @cached_property
    def features(self) -> dict[str, dict[str, np.ndarray]]:
        """Columns of features/<session>.h5 but for the features themselves, by session."""
        by_session = {}
        for name in self.study.sessions:
            path = self.folder / "features" / f"{name}.h5"
            if path.is_file():
                with open_features(path) as file:
                    by_session[name] = {key: _column(file[key]) for key in file if key != "feature"}
        return by_session

    @cached_property
    def findings(self) -> pd.DataFrame | None:
        """What the tests of all sessions found, one row each; None where no session has its table."""
        paths = [self.folder / "recordings" / f"{name}.findings.csv" for name in self.study.sessions]
        tables = [read_findings(path) for path in paths if path.is_file()]
        return pd.concat(tables, ignore_index=True) if tables else None

    def feature_row(self, session: str, row: int) -> np.ndarray:
        with open_features(self.folder / "features" / f"{session}.h5") as file:
            return file["feature"][row]

    @cached_property
    def agreement(self) -> pd.DataFrame | None:
        path = self.folder / "agreement.csv"
        table = read_agreement(path) if path.is_file() else None
        return None if table is None or table.empty else table

    def published_force_depth(self) -> pd.DataFrame | None:
        path = self.paper_folder and self.paper_folder / "force_depth.csv"
        return pd.read_csv(path, comment="#") if path and path.is_file() else None

    @cached_property
    def paper(self) -> dict | None:
        path = self.paper_folder and self.paper_folder / "paper_tables.json"
        return json.loads(path.read_text(encoding="utf-8")) if path and path.is_file() else None

    def table(self, name: str) -> pd.DataFrame | None:
        return _table(self.folder / "tables" / f"{name}.csv")

    @cached_property
    def manifest(self) -> dict | None:
        path = self.folder / "dataset" / "manifest.json"
        return read_manifest(path) if path.is_file() else None

    @cached_property
    def loss(self) -> pd.DataFrame | None:
        return _table(self.folder / "model" / "loss.csv")

    @cached_property
    def predictions(self) -> dict[str, np.ndarray] | None:
        """Columns of model/predictions.h5, what is of each bin left on disk (see predicted_map)."""
        path = self.folder / "model" / "predictions.h5"
        if not path.is_file():
            return None
        with _open_predictions(path) as file:
            small = [key for key in file if isinstance(file[key], h5py.Dataset) and file[key].ndim < 3]
            columns = {key: _column(file[key]) for key in small}
            for key in ("predicted_N", "true_N"):
                columns[f"total_{key}"] = np.concatenate(
                    [file[key][i : i + 512].sum(axis=1) for i in range(0, len(file[key]), 512)]
                )
        return columns

    def predicted_map(self, row: int) -> tuple[np.ndarray, np.ndarray]:
        """Return predicted and true force maps (B, 3) of a test row."""
        with _open_predictions(self.folder / "model" / "predictions.h5") as file:
            return file["predicted_N"][row], file["true_N"][row]


def _open_predictions(path: Path) -> h5py.File:
    return opened(path, None, f"evaluate the model again (snakemake -R {path})")


def _table(path: Path) -> pd.DataFrame | None:
    return read_product_table(path, f"make it again (snakemake -R {path})") if path.is_file() else None


def _column(data: h5py.Dataset) -> np.ndarray:
    return data.asstr()[()] if h5py.check_string_dtype(data.dtype) else data[()]


def is_papers_sensor(study: Study) -> bool:
    """True if size, layers and ball are the paper's, so that its published forces may be compared."""
    sensor = study.sensor
    thickness = [layer.thickness_mm for layer in sensor.layers]
    return (
        (sensor.width_x_mm, sensor.width_y_mm) == (32.0, 32.0)
        and thickness == [4.5, 1.5]
        and (study.indenter.kind, study.indenter.radius_mm) == ("sphere", 5.0)
    )
