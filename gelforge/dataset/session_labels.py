"""Labels of a session: its own sites where the sensor had another age or temperature, or its own indentations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import h5py
import numpy as np

from gelforge.dataset.schema import DatasetError
from gelforge.hdf5 import opened
from gelforge.indentation.cells.cell_file import Cell

FORMAT = "gelforge-presses-1"
# Other sums are refused (tests/dataset/test_join.py).
CLOSURE = (
    1e-6  # bins against the total force: relative, and as many newtons for bins below 1e-9 N stored as zero
)

# name: (unit, description); P indentations in the order recorded, B bins
PRESS_DATASETS = {
    "press": ("1", "indentation of the session (P)"),
    "cell": ("1", "site of the plan at which it is (P)"),
    "reason": ("1", "why it has no label; empty: it has one (P)"),
    "companion_reason": ("1", "why its error bars are as large as its forces; empty: they are not (P)"),
    "order": ("1", "order of the indentation in indentations.csv (P)"),
    "position_mm": ("mm", "planned position x, y (P, 2)"),
    "depth_mm": ("mm", "planned depth (P)"),
    "force_balance": ("1", "contact force less the force on the sensor's base, relative (P)"),
    "total_force_N": ("N", "contact force on the sensor (P, 3)"),
    "bin_force_N": ("N", "force on the sensor per surface bin, k = nx iy + ix, undeformed surface (P, B, 3)"),
    "total_sigma_mesh_N": ("N", "standard deviation of total_force_N from discretisation (P, 3)"),
    "bin_sigma_mesh_N": ("N", "standard deviation of bin_force_N from discretisation (P, B, 3)"),
    "total_sigma_material_N": (
        "N",
        "standard deviation of total_force_N from the constitutive models (P, 3)",
    ),
    "bin_sigma_material_N": ("N", "standard deviation of bin_force_N from the constitutive models (P, B, 3)"),
}


@dataclass(frozen=True)
class Label:
    """Forces of one indentation with their standard deviations [N], NaN where there are no error bars."""

    total: np.ndarray  # (3,)
    total_sigma: np.ndarray  # (3,)
    bins: np.ndarray  # (B, 3)
    bin_sigma: np.ndarray  # (B, 3)


@dataclass(frozen=True)
class OwnCells:
    """The sites of a session whose sensor had an age or a temperature of its own, and what their digests must be."""

    files: Mapping[str, Path]
    digests: Mapping[str, str] = field(default_factory=dict)  # those that are to be checked


@dataclass(frozen=True)
class OwnPresses:
    """The file of a session's indentations on a sensor that softens, and what its digest must be."""

    path: Path
    digest: str | None = None

    @cached_property
    def attributes(self) -> dict:
        """Return the file's attributes, after checking that it is whole and of the present settings."""
        with self._open() as file:
            stored = dict(file.attrs)
        if self.digest is not None and stored["inputs_digest"] != self.digest:
            raise DatasetError(
                f"{self.path}: made with other settings (inputs_digest {str(stored['inputs_digest'])[:12]}, expected "
                f"{self.digest[:12]}); solve the session again (snakemake -R {self.path})"
            )
        return stored

    @cached_property
    def reasons(self) -> dict[str, tuple[int, str]]:
        """Return by press, in the order recorded, its row and why it has no label; empty: it has."""
        with self._open() as file:
            failed = zip(file["press"].asstr()[()], file["reason"].asstr()[()])
            return {press: (row, reason) for row, (press, reason) in enumerate(failed)}

    @cached_property
    def totals(self) -> dict[str, np.ndarray]:
        """Return by press its total force (3,) [N]; NaN where it has no label."""
        with self._open() as file:
            return dict(zip(file["press"].asstr()[()], file["total_force_N"][()]))

    def reason(self, press: str) -> str:
        """Return why an indentation has no label; empty: it has."""
        if press not in self.reasons:
            raise DatasetError(
                f"{self.path}: no indentation {press}; solve the session again (snakemake -R {self.path})"
            )
        return self.reasons[press][1]

    def label(self, press: str) -> Label | str:
        """Return the label of an indentation, or why it has none."""
        if reason := self.reason(press):
            return reason
        row = self.reasons[press][0]
        with self._open() as file:
            known = {name: file[name][row] for name in PRESS_DATASETS if name.endswith("_N")}
        check_closure(
            self.path, f"indentation {press}", known["total_force_N"][None], known["bin_force_N"][None]
        )
        return Label(
            known["total_force_N"],
            np.hypot(known["total_sigma_mesh_N"], known["total_sigma_material_N"]),
            known["bin_force_N"],
            np.hypot(known["bin_sigma_mesh_N"], known["bin_sigma_material_N"]),
        )

    def _open(self) -> h5py.File:
        remedy = f"solve the session again (snakemake -R {self.path})"
        return opened(self.path, FORMAT, remedy, DatasetError)


def cell_label(cell: Cell, step: int) -> Label:
    """Return the label of one depth of a site."""
    total, bins = cell.arrays["total_force_N"][step], cell.arrays["bin_force_N"][step]
    return Label(total, sigma(cell, "total")[step], bins, sigma(cell, "bin")[step])


def sigma(cell: Cell, quantity: str) -> np.ndarray:
    """Return the standard deviation of a site's "bin" or "total" forces, NaN for a site without error bars."""
    arrays = cell.arrays
    mesh = arrays.get(f"{quantity}_sigma_mesh_N")
    if mesh is None:
        return np.full_like(arrays[f"{quantity}_force_N"], np.nan)
    between = arrays.get(f"{quantity}_sigma_interpolation_N", np.zeros(()))
    return np.sqrt(mesh**2 + arrays[f"{quantity}_sigma_material_N"] ** 2 + between**2)


def check_digest(path: str | Path, name: str, cell: Cell, expected: str | None) -> None:
    """Refuse the file of another site, or of one made with other settings.

    Parameters
    ----------
    path : str or Path
        The site's file, for the message.
    name : str
        The site that is needed.
    cell : Cell
        What the file holds.
    expected : str or None
        Digest of the settings; None where they do not matter.

    Raises
    ------
    DatasetError
        Names file, digest and remedy.
    """
    attributes = cell.attributes
    if attributes["cell"] != name:
        raise DatasetError(f"{path}: holds site {attributes['cell']!r}, expected {name!r}; simulate it again")
    if expected is not None and attributes["inputs_digest"] != expected:
        raise DatasetError(
            f"{path}: site {name} was made with other settings (inputs_digest {str(attributes['inputs_digest'])[:12]}, "
            f"expected {expected[:12]}); simulate it again (snakemake -R {path})"
        )


def check_closure(path: str | Path, what: str, total: np.ndarray, bins: np.ndarray) -> None:
    """Raise DatasetError where bins (D, B, 3) do not add up to the totals (D, 3) [N]."""
    error = np.abs(bins.sum(axis=1) - total)  # (D, 3)
    limit = CLOSURE + CLOSURE * np.linalg.norm(total, axis=1, keepdims=True)
    if not np.all(error <= limit):  # also refuses what is not a number
        raise DatasetError(
            f"{path}: {what}: bins and total force differ by {np.max(error):.3g} N, limit "
            f"{np.min(limit):.1g} N; simulate it again (snakemake -R {path})"
        )
