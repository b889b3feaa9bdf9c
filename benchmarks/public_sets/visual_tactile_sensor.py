"""Total forces from the markers of a real sensor, one file of four held out: zhiqi1234/Visual_tactile_sensor_4.0.

usage: python benchmarks/public_sets/visual_tactile_sensor.py --source FOLDER

60 markers are tracked in three dimensions while a hand presses; the six-axis force is on its own. Their displacements are
the features, the ridge regression of `gelforge.learning` the model. Its penalty is chosen by leaving out each training file
in turn. The set holds no distribution of force: only totals are compared.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from shared import found, parser_of, show_table
from sklearn.base import clone

from gelforge.learning.judging.baselines import RIDGE

REPOSITORY = "zhiqi1234/Visual_tactile_sensor_4.0"
FOLDER = "force_calibration"  # one sensor; `force_calibration_for0` is another
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class Presses:
    """One file: marker displacements (n, 180) [mm], forces (n, 3) [N], and how much two presses of it differ in time."""

    name: str
    markers: np.ndarray
    force: np.ndarray


def read(path: Path) -> Presses:
    """Return the displacements and forces of a processed file, rows with lost markers left out."""
    with h5py.File(path) as file:
        markers, force = file["vision/dxyz"][:], file["force/values"][:, :3]
    whole = np.isfinite(markers).all(axis=(1, 2)) & np.isfinite(force).all(axis=1)
    return Presses(path.stem.rpartition("_")[2], markers[whole].reshape(whole.sum(), -1), force[whole])


def predicted(training: list[Presses], markers: np.ndarray, model) -> np.ndarray:
    """Return the forces (n, 3) [N] at displacements (n, 180) of a model that is fitted to files."""
    known = np.concatenate([one.markers for one in training])
    mean, scale = known.mean(axis=0), known.std()
    fitted = clone(model).fit((known - mean) / scale, np.concatenate([one.force for one in training]))
    return fitted.predict((markers - mean) / scale)


def chosen(training: list[Presses]):
    """Return the ridge whose mean squared error is least over training files that are left out in turn."""
    losses = []
    for model in RIDGE:
        errors = []
        for k, out in enumerate(training):
            others = training[:k] + training[k + 1 :]
            errors.append(np.mean((predicted(others, out.markers, model) - out.force) ** 2))
        losses.append(np.mean(errors))
    return RIDGE[int(np.argmin(losses))]


def rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square (3,) over rows (n, 3)."""
    return np.sqrt(np.mean(values**2, axis=0))


def main() -> None:
    options = parser_of(__doc__, REPOSITORY).parse_args()
    files = sorted(found(options.source, FOLDER).glob("processed_calibration_*.h5"))
    if len(files) < 3:
        raise SystemExit(f"{options.source / FOLDER}: {len(files)} processed files, at least 3 are needed")
    sets = [read(path) for path in files]
    rows = []
    for k, out in enumerate(sets):
        training = sets[:k] + sets[k + 1 :]
        model = chosen(training)
        off = rms(predicted(training, out.markers, model) - out.force)
        size, constant = (
            rms(out.force),
            rms(out.force - np.concatenate([s.force for s in training]).mean(axis=0)),
        )
        rows.append(
            [
                out.name,
                str(len(out.force)),
                f"{model.alpha:g}",
                *(f"{off[a]:.2f} ({size[a]:.2f}, {constant[a]:.2f})" for a in range(3)),
            ]
        )
    print("error of total force [N] rms (in brackets: rms of the force, error of the training files' mean)\n")
    show_table(rows, ["held out", "rows", "penalty", *(f"F{a}" for a in AXES)])
    print("No distribution of force was measured: nothing is said about where on the gel a force acts.")


if __name__ == "__main__":
    main()
