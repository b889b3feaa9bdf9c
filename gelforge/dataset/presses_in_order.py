"""The recorded indentations of a session, solved one after another on one sensor that softens.

`presses.h5` holds one label per indentation. Until it is whole, a folder `presses.part` next to it holds what is solved so
far and the softening left, so that a killed job goes on where it was.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from zipfile import BadZipFile

import h5py
import numpy as np

import gelforge
from gelforge.config import ConfigError, Study
from gelforge.config.parts.effects import HistoryEffects
from gelforge.dataset.recorded_presses import Laws, RecordedPress, presses_digest
from gelforge.dataset.session_labels import FORMAT, PRESS_DATASETS
from gelforge.dataset.shard import PACKED
from gelforge.files import atomic, digest
from gelforge.hdf5 import writing
from gelforge.indentation.cells.cell_file import Cell, check_finite, write_timings
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import solve_companion
from gelforge.indentation.solving.error_bars import COARSER, Companion, error_bars
from gelforge.indentation.solving.resolution import resolution_of
from gelforge.indentation.solving.simulate import simulate_in_order
from gelforge.mechanics.bodies.peak_grid import Box, PeakGrid
from gelforge.mechanics.contact.forces import OPEN
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.progress import tracked

ROWS = ("force", "sigma_mesh", "sigma_material")  # of a label, each the total and then the bins (1 + B, 3)


@dataclass
class Progress:
    """How far a session is followed: kept after every indentation."""

    digest: str
    done: int = 0
    reason: str = ""  # why the indentation after those done could not be solved
    labels: str = ""  # SHA-256 of the labels of those done
    companion_reasons: list[str] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    balances: list[float] = field(default_factory=list)
    grids: dict[str, PeakGrid | None] = field(default_factory=lambda: {"fine": None, "coarse": None})


def press_in_order(
    study: Study,
    laws: Laws,
    uncertain: Mapping[str, Sequence[PrincipalLaw]],
    presses: Sequence[RecordedPress],
    session: str,
    out: Path,
) -> str:
    """Write the labels of a session's indentations, followed in their order from an untouched sensor.

    What an indentation leaves is carried to the next, so one that cannot be solved ends the session: it and those after it
    are in the file with the reason. A run that was stopped goes on where it ended.

    Parameters
    ----------
    study : Study
        As it was in the session.
    laws : mapping of str to PrincipalLaw
        By material [MPa].
    uncertain : mapping of str to sequence of PrincipalLaw
        As of companion.simulate_label.
    presses : sequence of RecordedPress
        In their order.
    session : str
        Its name.
    out : Path
        The file of labels.

    Returns
    -------
    str
        Why it ended early; "" if it did not.
    """
    part = part_of(out)
    identity = presses_digest(study, laws, presses)
    moved = {name: [law.description() for law in several] for name, several in uncertain.items()}
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    labels, progress = _resumed(part, digest([identity, moved]), (len(presses), len(ROWS), 1 + bins, 3))
    for number in tracked(range(progress.done, len(presses)), f"indentations of session {session}"):
        if progress.reason:
            break
        _press(study, laws, uncertain, presses[number], progress, labels[number])
        labels.flush()  # before the progress that counts it
        progress.labels = _sum_of(labels, progress.done)
        _keep(part, progress)
    _write(out, study, laws, session, identity, presses, progress, labels)
    del labels
    shutil.rmtree(part)
    return progress.reason


def part_of(out: Path) -> Path:
    """Return the folder of what is solved of a session whose file is not whole."""
    return out.with_name(f"{out.stem}.part")


def discard_part(out: Path) -> None:
    """Remove what an earlier job has solved of a session, so that it begins with the first indentation.

    Parameters
    ----------
    out : Path
        File of the session's labels, which is not touched.
    """
    if part_of(out).exists():
        shutil.rmtree(part_of(out))
        print("earlier solutions are discarded, as asked; starting with the first indentation", flush=True)


def _press(
    study: Study, laws: Laws, uncertain, press: RecordedPress, progress: Progress, label: np.ndarray
) -> None:
    """Solve one indentation into its label (3, 1 + B, 3), and note what it left behind, or why it could not be solved."""
    wall_clock = time.perf_counter()
    cell, grid = _solved(study, laws, press, progress.grids["fine"])
    if not cell.converged:
        progress.reason = str(cell.attributes["reason"])
        return
    check_finite(f"indentation {press.name}", cell)  # NaN in a label says that there is none
    total, bins = cell.arrays["total_force_N"][-1:], cell.arrays["bin_force_N"][-1:]
    label[:] = np.nan
    label[0] = np.concatenate([total, bins[0]])
    reason = ""
    if study.mechanics.error_bars:
        companion, coarse_grid, reason = _companion(study, laws, uncertain, press, progress.grids["coarse"])
        shape = (study.sensor.bins.ny, study.sensor.bins.nx)
        touched = (cell.arrays["node_state"][-1:] != OPEN).sum(axis=1)
        site = press.path.x_mm, press.path.y_mm
        resolution = resolution_of(study.sensor, study.mechanics.mesh, laws, *site)
        bars = error_bars(total, bins, touched, shape, companion, resolution)
        for row, which in enumerate(ROWS[1:], start=1):
            label[row] = np.concatenate([bars[f"total_{which}_N"], bars[f"bin_{which}_N"][0]])
        progress.grids["coarse"] = grid if reason else coarse_grid  # it lives on places, not on a mesh
    progress.grids["fine"] = grid
    progress.done += 1
    progress.companion_reasons.append(reason)
    progress.balances.append(float(cell.attributes["force_balance"][-1]))
    progress.seconds.append(time.perf_counter() - wall_clock)


def _solved(
    study: Study, laws: Laws, press: RecordedPress, grid: PeakGrid | None
) -> tuple[Cell, PeakGrid | None]:
    """Return the site of one indentation and the softening left after it."""
    sensor, by_layer = study.sensor, study.sensor.by_layer(laws)
    return next(simulate_in_order(sensor, study.indenter, study.mechanics, by_layer, [press.path], grid))


def _companion(
    study: Study, laws: Laws, uncertain, press: RecordedPress, grid: PeakGrid | None
) -> tuple[Companion, PeakGrid | None, str]:
    """Return the coarser solution of an indentation, which carries its own softening, what that is then, and why there is
    none.

    How forces follow the laws is taken from an indentation without history, as for sites.
    """
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    slopes = np.zeros((0, 1, 3)), np.zeros((0, 1, bins, 3))
    nothing = Companion(np.empty((0, 3)), np.empty((0, bins, 3)), slopes[0][:, :0], slopes[1][:, :0])
    try:
        cell, left = _solved(_coarser(study), laws, press, grid)
        if not cell.converged:
            return nothing, grid, str(cell.attributes["reason"])
        if any(uncertain.values()):
            planned = PlannedCell(press.cell, press.path.x_mm, press.path.y_mm, (press.depth_mm,))
            without = study.with_values({"mechanics": {"effects": {"history": HistoryEffects()}}})
            plain, reason, _ = solve_companion(without, dict(laws), planned, uncertain)
            if reason:
                return nothing, grid, reason
            slopes = plain.total_slopes, plain.bin_slopes
    except (ConfigError, NotConverged) as failure:
        return nothing, grid, str(failure)
    forces = cell.arrays["total_force_N"][-1:], cell.arrays["bin_force_N"][-1:]
    return Companion(*forces, *slopes), left, ""


def _coarser(study: Study) -> Study:
    """Return the study with all sizes of mesh and softening's grid doubled."""
    mechanics = study.mechanics
    history = {"grid_mm": COARSER * mechanics.effects.history.grid_mm}
    changes = {"mesh": mechanics.mesh.coarser(COARSER), "effects": {"history": history}}
    return study.with_values({"mechanics": changes})


# ------------------------------------------------------------------------------------------- what is kept
def _resumed(part: Path, identity: str, shape: tuple[int, ...]) -> tuple[np.memmap, Progress]:
    """Return labels and progress of a session that was broken off under the same settings; of one that begins otherwise."""
    labels = part / "labels.npy"
    try:
        progress = _read_progress(part / "progress.npz")
        if progress.digest == identity:
            solved = np.lib.format.open_memmap(labels, mode="r+")
            if solved.shape == shape and _sum_of(solved, progress.done) == progress.labels:
                print(f"{progress.done} indentations were solved before; continuing from there", flush=True)
                return solved, progress
            raise ValueError("the labels are not those that were kept")
        print(
            "settings, indentations or code have changed since this session was interrupted; starting with the first"
            " indentation"
        )
    except (OSError, ValueError, KeyError, BadZipFile):
        pass  # none yet, or damaged: it costs time, not the run
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    return np.lib.format.open_memmap(labels, mode="w+", dtype=float, shape=shape), Progress(identity)


def _sum_of(labels: np.ndarray, done: int) -> str:
    return hashlib.sha256(np.ascontiguousarray(labels[:done]).data).hexdigest()


def _keep(part: Path, progress: Progress) -> None:
    known = {name: value for name, value in vars(progress).items() if name != "grids"}
    arrays = {
        f"{mesh}/{region}/{name}": getattr(box, name)
        for mesh, grid in progress.grids.items()
        for region, box in (grid.boxes if grid else {}).items()
        for name in ("low", "high", "values")
    }
    with atomic(part / "progress.npz") as temporary, open(temporary, "wb") as file:
        np.savez(file, known=np.array(json.dumps(known)), **arrays)


def _read_progress(path: Path) -> Progress:
    with np.load(path) as file:
        progress = Progress(**json.loads(str(file["known"])))
        for mesh in progress.grids:
            regions = {key.split("/")[1] for key in file if key.startswith(f"{mesh}/")}
            boxes = {
                region: Box(*(file[f"{mesh}/{region}/{name}"] for name in ("low", "high", "values")))
                for region in sorted(regions)
            }
            progress.grids[mesh] = PeakGrid(boxes) if boxes else None
    return progress


def _write(out, study, laws, session, identity, presses, progress: Progress, labels) -> None:
    """Write the file of a session's indentations, whole or not at all."""
    count, left = len(presses), len(presses) - progress.done
    reasons = [""] * progress.done
    if left:
        failed = presses[progress.done].name
        later = f"not solved, because the earlier indentation {failed} could not be solved"
        reasons += [progress.reason, *[later] * (left - 1)]
    columns = {
        "press": [press.name for press in presses],
        "cell": [press.cell for press in presses],
        "reason": reasons,
        "companion_reason": progress.companion_reasons + [""] * left,
        "order": np.array([press.order for press in presses]),
        "position_mm": np.array([(press.path.x_mm, press.path.y_mm) for press in presses]),
        "depth_mm": np.array([press.depth_mm for press in presses]),
        "force_balance": np.array(progress.balances + [np.nan] * left),
    }
    described = {
        name: getattr(study, name).model_dump(mode="json") for name in ("sensor", "indenter", "mechanics")
    }
    described["laws"] = {name: law.description() for name, law in laws.items()}
    attributes = {
        "format": FORMAT,
        "session": session,
        "inputs_digest": identity,
        "code_version": gelforge.__version__,
        "status": "failed" if left else "converged",
        "reason": progress.reason,
        "settings": json.dumps(described, sort_keys=True),
    }
    with writing(out) as file:
        file.attrs.update(attributes)
        for name, values in columns.items():
            text = {"dtype": h5py.string_dtype()} if isinstance(values, list) else {}
            file.create_dataset(name, data=values, **text)
        for row, which in enumerate(ROWS):
            total, bins = (f"{quantity}_{which}_N" for quantity in ("total", "bin"))
            file.create_dataset(total, (count, 3), float)
            size = labels.shape[2] - 1, 3
            file.create_dataset(bins, (count, *size), float, chunks=(1, *size), **PACKED)
            copied = 256  # indentations in memory at a time
            for first in range(0, count, copied):
                chosen = slice(first, min(first + copied, count))
                known = labels[chosen, row].copy()
                known[max(0, progress.done - first) :] = np.nan
                file[total][chosen], file[bins][chosen] = known[:, 0], known[:, 1:]
        for name, data in file.items():
            data.attrs["units"], data.attrs["description"] = PRESS_DATASETS[name]
    write_timings(out, {"seconds": progress.seconds})
