"""FEATS: a sample per file, a dictionary of the image, three grids of forces and their sums."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gelforge.importing.public.arrays import files_of, load_arrays
from gelforge.importing.public.labelled import UNKNOWN, Layout, Options, Reading
from gelforge.importing.refusals import ImportingError

SUMS, GRIDS = ("f_x", "f_y", "f_z"), ("grid_x", "grid_y", "grid_z")
# of their own machine's records: start and displacement [mm]
RAW = ("x_0", "y_0", "z_0", "d_x", "d_y", "d_z")
TORQUES = ("m_x", "m_y", "m_z")  # [N m]


def read(path: Path, options: Options) -> Iterator[Reading]:
    """Yield a reading per sample: published labels, or records of their machine, which hold positions too."""
    for file in files_of(path, (".npz", ".npy"), "samples (.npz)"):
        sample = load_arrays(file)
        if missing := [key for key in ("gs_img", *SUMS) if key not in sample]:
            raise ImportingError(
                f"{file}: no {', '.join(missing)} among {', '.join(sorted(sample)) or 'nothing'}; name the folder of samples"
            )
        force = np.array([_scalar(file, sample, key) for key in SUMS])
        if all(key in sample for key in GRIDS):
            _refuse_other_sums(file, sample, force)
        position: np.ndarray | tuple = UNKNOWN
        torque: np.ndarray | tuple = UNKNOWN
        if all(key in sample for key in RAW):
            at = [_scalar(file, sample, key) for key in RAW]
            position = np.array(at[:3]) + at[3:]
        if all(key in sample for key in TORQUES):
            torque = 1e3 * np.array([_scalar(file, sample, key) for key in TORQUES])
        yield Reading(sample["gs_img"], force, file.stem, position_mm=position, torque_Nmm=torque)


def _scalar(file: Path, sample: dict, key: str) -> float:
    if sample[key].size != 1:
        raise ImportingError(
            f"{file}: {key} is an array {sample[key].shape}, one number is needed; fetch the file again"
        )
    return float(sample[key].reshape(-1)[0])


def _refuse_other_sums(file: Path, sample: dict, force: np.ndarray) -> None:
    """Raise ImportingError where a total is not the sum of its grid within 1 %."""
    sums = np.array([sample[key].sum() for key in GRIDS])
    off = np.abs(sums - force).max()
    if off > 0.01 * max(np.abs(force).max(), 0.1):
        raise ImportingError(
            f"{file}: the grids sum to {np.round(sums, 4).tolist()} N, f_x, f_y, f_z are {np.round(force, 4).tolist()} N;"
            " fetch the file again"
        )


LAYOUT = Layout(
    name="feats",
    what="GelSight Mini with markers pressed by 24 indenters on a milling machine, one image each",
    force="simulated: sums of the grids of FEATS's own finite elements, not the load cell's readings",
    reference="none in a sample; the authors' repository holds one image without contact",
    lacks="the samples hold one image each and no positions of the stage, so that depth and contact point are not known",
    licence="code MIT; the licence of the data stands on their card",
    read=read,
)
