"""The file of a simulated cell: written whole, read with every check that a join needs."""

from __future__ import annotations

import json
import resource
import sys
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

from gelforge.files import write_json
from gelforge.hdf5 import opened, writing

FORMAT = "gelforge-cell-1"

# name: (unit, description); D depths, B bins, S surface nodes, G gel nodes, E gel elements
DATASETS = {
    "depth_mm": ("mm", "commanded depths (D)"),
    "shear_mm": ("mm", "displacement of the indenter along x and y from the site's position (D, 2)"),
    "tilt_deg": ("deg", "turns of the indenter about the sensor's x and y axes since the first touch (D, 2)"),
    "twist_deg": ("deg", "turn of the indenter about the sensor's z axis; absent where none turns (D)"),
    "indenter_mm": ("mm", "the indenter's centre (D, 3)"),
    "total_force_N": ("N", "contact force on the sensor (D, 3)"),
    "reaction_N": ("N", "sum of internal forces at the fixed nodes, the force of the base on the sensor (D, 3)"),
    "bin_force_N": ("N", "force on the sensor per surface bin, k = nx iy + ix, undeformed surface (D, B, 3)"),
    "bin_normal_N": ("N", "part of bin_force_N along the contact normal (D, B, 3)"),
    "bin_shear_N": ("N", "part of bin_force_N due to friction (D, B, 3)"),
    "bin_sigma_mesh_N": ("N", "standard deviation of bin_force_N from discretisation (D, B, 3)"),
    "bin_sigma_material_N": (
        "N", "standard deviation of bin_force_N from the covariance of the constitutive models' parameters (D, B, 3)"),
    "bin_sigma_interpolation_N": (
        "N", "of a label between solved sites, standard deviation of bin_force_N from what is solved there (D, B, 3)"),
    "total_sigma_mesh_N": ("N", "standard deviation of total_force_N from discretisation (D, 3)"),
    "total_sigma_material_N": ("N", "standard deviation of total_force_N from the constitutive models (D, 3)"),
    "total_sigma_interpolation_N": ("N", "the same of total_force_N (D, 3)"),
    "sensitivity_total": ("N/unit", "d total_force_N / d amount of each of sensitivity_names (P, D, 3)"),
    "sensitivity_bin": ("N/unit", "d bin_force_N / d amount of each of sensitivity_names (P, D, B, 3)"),
    "sensitivity_gel_displacement": (
        "mm/unit", "d gel_displacement_mm / d amount of each of sensitivity_names (P, D, G, 3)"),
    "side_force_N": ("N", "contact force on the side faces, part of the total but of no bin (D, 3)"),
    "node_xy_mm": ("mm", "undeformed positions of the nodes of the top surface (S, 2)"),
    "node_area_mm2": ("mm2", "undeformed area over which each surface node's force acts, 0 at corners of tetrahedra (S)"),
    "node_normal_N": ("N", "normal contact force on each surface node (D, S, 3)"),
    "node_shear_N": ("N", "friction force on each surface node (D, S, 3)"),
    "node_state": ("1", "0 open, 1 stick, 2 slip (D, S)"),
    "node_displacement_mm": ("mm", "displacement of the surface nodes (D, S, 3)"),
    "section_node_mm": ("mm", "undeformed nodes of the vertical mesh plane y = const nearest the site (P, 3)"),
    "section_quad": ("1", "4 corners of each face of the plane as rows of section_node_mm (Q, 4)"),
    "section_region": ("1", "region of each face, an index into the attribute regions (Q)"),
    "section_displacement_mm": ("mm", "displacement of section_node_mm (D, P, 3)"),
    "gel_node_mm": (
        "mm", "undeformed nodes of the layers with particles, of all where none has any; z = 0 at the top (G, 3)"),
    "gel_hex": ("1", "8 corners of each element as rows of gel_node_mm (E, 8)"),
    "gel_tet": ("1", "10 nodes of each quadratic tetrahedron as rows of gel_node_mm, instead of gel_hex (E, 10)"),
    "gel_displacement_mm": ("mm", "displacement of gel_node_mm (D, G, 3)"),
}  # fmt: skip
ERROR_BARS = {name for name in DATASETS if "_sigma_" in name}
# kept only with mechanics.store_displacement, error_bars, sensitivities
SENSITIVITIES = {name for name in DATASETS if name.startswith("sensitivity_")}
GEL = {name for name in DATASETS if name.startswith("gel_")}
OPTIONAL = GEL | {"twist_deg"} | ERROR_BARS | SENSITIVITIES
# a mirrored site's is that of its source
SECTION = {name for name in DATASETS if name.startswith("section_")}
NODES = {name for name in DATASETS if name.startswith("node_")}  # an interpolated label has none
# attributes that differ from run to run: they go into a file of their own, so that a site's bytes repeat
TIMINGS = ("seconds", "cpu_seconds", "error_bar_seconds", "sensitivity_seconds")
# attributes: of a law without a tested range (stretch_range.py)
UNKNOWN_IS_NAN = {"volume_outside_valid_range"}


class CellError(ValueError):
    """A site file that cannot be used: which, what was found, what to do."""


@dataclass(frozen=True)
class Cell:
    """One simulated position: arrays named as in DATASETS, attributes as in docs/file-formats.md.

    attributes always hold: format, cell, x_mm, y_mm, status ("converged" or "failed"), reason, last_good_depth_mm,
    inputs_digest, code_version, iterations; of a site just solved also TIMINGS.
    Arrays of a failed site hold the depths that converged.
    """

    arrays: dict[str, np.ndarray]
    attributes: dict = field(default_factory=dict)

    def __repr__(self) -> str:
        known, depths = self.attributes, len(self.arrays.get("depth_mm", ()))
        at = ", ".join(f"{key} {known[key]:g}" for key in ("x_mm", "y_mm") if key in known)
        names = ", ".join(sorted(self.arrays))
        return f"Cell {known.get('cell', '')}: {known.get('status', '')}, {at}, {depths} depths; {names}"

    @property
    def converged(self) -> bool:
        return self.attributes["status"] == "converged"


def write_cell(path: str | Path, cell: Cell) -> None:
    """Write a site, whole or not at all.

    Parameters
    ----------
    path : path
        HDF5 file. What TIMINGS name goes into <name>.timings.json next to it, see read_timings; the rest is the same, byte
        for byte, from the same inputs on the same machine.
    cell : Cell
        Arrays named as in DATASETS, with attributes.

    Raises
    ------
    CellError
        A number that is not finite: forces, fields, error bars, derivatives and attributes all are, but for UNKNOWN_IS_NAN.
    """
    check_finite(path, cell)
    timings = {key: cell.attributes[key] for key in TIMINGS if key in cell.attributes}
    with writing(path) as file:
        file.attrs["format"] = FORMAT
        for key in sorted(cell.attributes.keys() - timings.keys()):
            file.attrs[key] = cell.attributes[key]
        for name, array in sorted(cell.arrays.items()):  # a set of names has another order in each process
            unit, description = DATASETS[name]
            packed = {"compression": "gzip", "shuffle": True} if array.size > 4096 else {}
            data = file.create_dataset(name, data=array, **packed)
            data.attrs["units"], data.attrs["description"] = unit, description
    write_timings(path, timings)


def write_timings(path: str | Path, timings: Mapping) -> None:
    """Write what a product cost into a file next to it.

    Parameters
    ----------
    path : str or Path
        The product, such as a site's file.
    timings : mapping of str to number
        Seconds by name; the memory of this process is added.
    """
    plain = {key: np.asarray(value).tolist() for key, value in timings.items()}
    write_json(timings_path(path), plain | {"peak_memory_MB": round(peak_memory_MB(), 1)})


def peak_memory_MB() -> float:
    """Return the largest resident set of this process so far."""
    largest = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return largest / (2**20 if sys.platform == "darwin" else 1024)  # macOS counts bytes, Linux kilobytes


def read_timings(path: str | Path) -> dict:
    """Return what a product cost.

    Parameters
    ----------
    path : str or Path
        The product, such as a site's file.

    Returns
    -------
    dict
        Seconds and memory [MB] by name; empty where nobody knows.
    """
    try:
        return json.loads(timings_path(path).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}


def timings_path(path: str | Path) -> Path:
    """Return the file that says what a product cost."""
    return Path(path).with_suffix(".timings.json")


def check_finite(whose: str | Path, cell: Cell) -> None:
    """Refuse a site with a number that is not finite.

    Parameters
    ----------
    whose : str or Path
        Names the site in the message.
    cell : Cell
        Its arrays and attributes; those in UNKNOWN_IS_NAN may be NaN.

    Raises
    ------
    CellError
        Names the array, how many of its numbers are not finite, and the first.
    """
    known = {name: value for name, value in cell.attributes.items() if name not in UNKNOWN_IS_NAN}
    for name, value in (cell.arrays | known).items():
        values = np.asarray(value)
        if values.dtype.kind != "f" or np.isfinite(values).all():
            continue
        bad = np.argwhere(~np.isfinite(values))
        raise CellError(
            f"{whose}: {len(bad)} of {values.size} numbers of {name} are not finite, the first is"
            f" {values[tuple(bad[0])]} at {bad[0].tolist()}; nothing is written: press in smaller steps of depth or on"
            " another mesh, and report the site's settings"
        )


def read_cell(path: str | Path, arrays: list[str] | None = None, if_held: Collection[str] = ()) -> Cell:
    """Return a site from its file.

    Parameters
    ----------
    path : path
        An HDF5 file that write_cell has written.
    arrays : list of str, optional
        Names of the arrays that are read; all that a site holds if not given.
    if_held : collection of str
        Names of arrays that are read where the file has them.

    Returns
    -------
    Cell
        Arrays by name and attributes.

    Raises
    ------
    CellError
        A file that is missing, damaged, of another format or incomplete, by name.
    """
    with opened(path, FORMAT, f"simulate it again (snakemake -R {path})", CellError) as file:
        attributes = dict(file.attrs)
        wanted = _held(attributes, file) if arrays is None else arrays
        wanted = [*wanted, *sorted(name for name in if_held if name in file and name not in wanted)]
        missing = [name for name in wanted if name not in file]
        content = {name: file[name][()] for name in wanted if name in file}
    if missing:
        raise CellError(
            f"{path}: datasets {missing} are missing; simulate the site again with the settings that keep them"
        )
    return Cell(content, attributes)


def _held(attributes: dict, file: h5py.File) -> list[str]:
    """Return the names of the arrays that a site must hold, and of the optional ones that it does hold."""
    between = "interpolated_from" in attributes or "solved_as" in attributes
    absent = (
        OPTIONAL | (SECTION if attributes.get("source") else set()) | (SECTION | NODES if between else set())
    )
    if between and attributes["status"] == "failed":
        absent = set(DATASETS) - {"depth_mm", "total_force_N", "bin_force_N"}
    return [name for name in DATASETS if name not in absent or name in file]
