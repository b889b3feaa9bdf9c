"""Synthetic sessions: indentations in random order, force/torque readings and images, as a laboratory's own."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from gelforge.config import (
    DepthZero,
    ForceSensor,
    Session,
    StageToSensor,
    Study,
    VirtualLab,
    VirtualSession,
    load_session,
    write_yaml,
)
from gelforge.files import remove_orphans, temporary_beside, write_text
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.progress import tracked
from gelforge.recording.imaging.images import reference_path
from gelforge.recording.readings import FORCE
from gelforge.virtual_lab.imaging import expose, focused, picture
from gelforge.virtual_lab.particles import (
    Motion,
    PathMotion,
    VirtualLabError,
    path_motion,
    place_particles,
    serial_seed,
    true_motion,
)
from gelforge.virtual_lab.true_solutions import read_truth
from gelforge.virtual_lab.truth import check_recordable

COLUMNS = "press cell order time_s phase x_mm y_mm depth_mm speed_mm_per_s dwell_s".split()
# The course of an indentation: zero is read above the surface, then the stage goes down, waits, takes images and goes up.
# On a path it waits at every step and takes one image there.
CLEAR_MM, SPEED_MM_PER_S = 1.0, 1.0
ZERO_S, LOAD_S, SETTLE_S, FRAME_S, PRESS_S = (0.0, 0.1, 0.2), 4.0, 0.5, 0.1, 12.0
# Noise has no repeats to be found: Huffman codes alone are smaller and twice as fast as any level of the full search.
PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY]
README = """SYNTHETIC session {session}, made by the virtual lab of gelforge, not measured.

Sensor {serial} exists only in simulation: its gel deforms as a finite-element model says whose physics the study does
not know, its camera and its force sensor are models with seeded noise. The files have the format of a laboratory's own
session.
"""


@dataclass(frozen=True)
class Press:
    """One indentation of a session: to a depth, or along the path of its site."""

    order: int
    cell: PlannedCell
    depth_mm: float  # of a path the deepest
    start_s: float = 0.0

    @property
    def name(self) -> str:
        return f"p{self.order:05d}"


@dataclass(frozen=True)
class Bench:
    """What stands on the virtual bench during a session."""

    lab: VirtualLab
    session: VirtualSession
    particles: np.ndarray  # (P, 3) undeformed centres [mm]
    untouched: np.ndarray  # (H, W[, 3]) noise-free image at zero force
    offset_N: np.ndarray  # (3,) untared zero in the force sensor's axes
    last: int = 0  # number of the session's last indentation

    def exposure(self, press: Press) -> float:
        """Return the exposure at an indentation over that of the first; it drifts evenly from one to the next."""
        drift = self.lab.imaging.exposure_drift
        return 1.0 + drift * press.order / self.last if drift and self.last else 1.0


def session_cells(lab: VirtualLab, cells: Mapping[str, PlannedCell]) -> dict[str, list[str]]:
    """Return the names of the sites that each session visits, in the order of the plan: disjoint, all covered, by share.

    Parameters
    ----------
    lab : VirtualLab
        Its sessions and their shares; the sensor's serial seeds the draw.
    cells : mapping of str to PlannedCell
        Sites of the plan.

    Returns
    -------
    dict of str to list of str
        By session.
    """
    names = np.array(list(cells), dtype=object)
    order = np.random.default_rng(serial_seed(lab.serial)).permutation(len(names))
    shares = np.cumsum([session.share for session in lab.sessions])
    ends = np.rint(shares / shares[-1] * len(names)).astype(int)
    parts = np.split(order, ends[:-1])
    # within a session the sites stand in the order of the plan
    return {session.session: list(names[np.sort(part)]) for session, part in zip(lab.sessions, parts)}


def make_session(
    lab: VirtualLab,
    lab_session: VirtualSession,
    study: Study,
    cells: Mapping[str, PlannedCell],
    truth_folder: str | Path,
    out_folder: str | Path,
    workers: int = 1,
) -> None:
    """Write a synthetic session folder, whole or not at all.

    The same inputs give the same bytes, however many worker threads draw.

    Parameters
    ----------
    lab : VirtualLab
        Camera, imaging, particles and force sensor.
    lab_session : VirtualSession
        One of its sessions.
    study : Study
        Sensor and indenter as the user knows them.
    cells : mapping of str to PlannedCell
        Sites of the plan.
    truth_folder : str or Path
        Holds the true solutions <cell>.h5.
    out_folder : str or Path
        Of the session; a synthetic one in it is replaced.
    workers : int
        Threads.

    Raises
    ------
    VirtualLabError
        When out_folder holds anything but a synthetic session, and for a path that cannot be recorded. Also for a true
        solution that failed or does not reach a depth of the plan.
    """
    out_folder = Path(out_folder)
    _refuse_real(out_folder)
    for planned in cells.values():
        check_recordable(planned)
    cv2.setNumThreads(1)  # the worker threads draw side by side instead
    presses = random_presses(
        lab_session, [cells[name] for name in session_cells(lab, cells)[lab_session.session]]
    )
    bench = replace(_bench(lab, lab_session, study), last=len(presses) - 1)
    by_cell: dict[str, list[Press]] = {}
    for press in presses:
        by_cell.setdefault(press.cell.name, []).append(press)
    remove_orphans(out_folder.parent)
    temporary = temporary_beside(out_folder)
    try:
        (temporary / "images").mkdir(parents=True)
        record = partial(_record_cell, bench, study, Path(truth_folder), temporary / "images")
        with ThreadPoolExecutor(workers) as pool:
            recorded = tracked(pool.map(record, by_cell.values()), "sites recorded", len(by_cell))
            tables = [table for of_cell in recorded for table in of_cell]
        rng = np.random.default_rng([lab_session.seed, 3])
        _write_image(reference_path(temporary), expose(bench.untouched, lab.imaging, rng))
        readings = pd.concat(tables).sort_values(["order", "time_s"], kind="stable")
        write_text(temporary / "indentations.csv", readings.to_csv(index=False, lineterminator="\n"))
        write_yaml(temporary / "session.yaml", session_description(lab, lab_session, study))
        write_text(temporary / "README.txt", README.format(session=lab_session.session, serial=lab.serial))
        shutil.rmtree(out_folder, ignore_errors=True)
        os.replace(temporary, out_folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def random_presses(lab_session: VirtualSession, cells: list[PlannedCell]) -> list[Press]:
    """Return the indentations of all sites and depths in a random order, so that drift and position do not run together.

    A path is one indentation.
    """
    every = [(c, depth) for c in cells for depth in ((c.deepest_mm,) if c.follows_a_path else c.depths_mm)]
    order = np.random.default_rng([lab_session.seed, 0]).permutation(len(every))
    away_s = CLEAR_MM / SPEED_MM_PER_S + SETTLE_S
    lasts = [max(PRESS_S, path_times(every[index][0])[-1] + away_s) for index in order]
    starts = np.concatenate([[0.0], np.cumsum(lasts)])
    return [
        Press(number, cell, depth, float(starts[number]))
        for number, (cell, depth) in enumerate(every[index] for index in order)
    ]


def path_times(cell: PlannedCell) -> np.ndarray:
    """Return when each step of a site's path is read (S,) [s], from the start of the indentation: after a wait at the step.

    [0] for a site without a path.
    """
    if not cell.follows_a_path:
        return np.zeros(1)
    pose = np.column_stack([cell.depths_mm, cell.shears_mm or np.zeros((len(cell.depths_mm), 2))])
    way = np.append(0.0, np.linalg.norm(np.diff(pose, axis=0), axis=1))
    return LOAD_S + np.cumsum(way / SPEED_MM_PER_S + SETTLE_S)


def session_description(lab: VirtualLab, lab_session: VirtualSession, study: Study) -> Session:
    """Return what session.yaml says of a synthetic session: nothing of the hidden truth."""
    bench = {"acts_on": lab_session.acts_on, "axes": lab_session.axes}
    return Session(
        session=lab_session.session,
        synthetic=True,
        sensor=lab.serial,
        indenter=study.indenter.words,
        date=lab_session.date,
        notes="SYNTHETIC: made by a virtual lab, not measured",
        force=ForceSensor(tared=False, resolution_N=lab.force.resolution_N, **bench),
        stage_to_sensor=lab_session.stage_to_sensor,
        depth_zero=DepthZero(
            by="press",
            how="contact point of every indentation",
            press_scatter_mm=lab.force.contact_point_scatter_mm,
        ),
        camera=lab.camera,
    )


def sensor_to_stage(xy: np.ndarray, stage: StageToSensor) -> np.ndarray:
    """Return the stage positions (..., 2) [mm] commanded for positions in the sensor frame."""
    c, s = np.cos(np.deg2rad(stage.rotation_deg)), np.sin(np.deg2rad(stage.rotation_deg))
    turned_back = (np.asarray(xy) - stage.origin_mm) @ np.array([[c, -s], [s, c]])
    return turned_back * [1.0, -1.0 if stage.handedness == "left" else 1.0]


def press_rows(
    press: Press, truth: Motion, contact_point_off_mm: float, bench: Bench
) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the rows of an indentation without forces, and the true force (R, 3) [N] on the sensor at each.

    The stage goes to the commanded depth from a contact point that is off by contact_point_off_mm. An indentation to the
    site's deepest depth is followed during unloading; unloading from other depths has not been simulated and is not read.
    """
    deepest = np.isclose(press.depth_mm, truth.deepest_mm)
    unload = [d for d in bench.lab.unload_depths_mm if d < press.depth_mm] if deepest else []
    images = bench.lab.imaging.images_per_press
    last = LOAD_S + SETTLE_S + FRAME_S * images
    # phase, seconds, depth, seconds since arrival, image
    course = [("zero", t, -CLEAR_MM, np.nan, f"{press.name}_zero.png" if t == 0 else "") for t in ZERO_S]
    course += [("load", LOAD_S, press.depth_mm, 0.0, "")]
    waits = [SETTLE_S + FRAME_S * i for i in range(images)]
    course += [("dwell", LOAD_S + w, press.depth_mm, w, f"{press.name}_{i}.png") for i, w in enumerate(waits)]
    course += [("unload", last + (press.depth_mm - d) / SPEED_MM_PER_S, d, np.nan, "") for d in unload]
    rows = pd.DataFrame(course, columns=["phase", "time_s", "depth_mm", "dwell_s", "image"])
    held = truth.force(max(press.depth_mm + contact_point_off_mm, 0.0))
    force = {"zero": np.zeros(3), "load": held, "dwell": held}
    on_sensor = [
        truth.unload_force(max(depth + contact_point_off_mm, 0.0)) if phase == "unload" else force[phase]
        for phase, depth in zip(rows["phase"], rows["depth_mm"])
    ]
    return _described(rows, press, bench), np.array(on_sensor)


def path_rows(
    press: Press, truth: PathMotion, deeper_mm: float, bench: Bench
) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the rows of an indentation along its site's path without forces, and the true force (R, 3) [N] on the sensor
    at each.

    One reading with its image at each step, after the stage has come to rest there; a planned wait has the phase of the
    motion before it.
    """
    cell, steps = press.cell, range(len(press.cell.depths_mm))
    phases = list(cell.phases)
    for step in steps:
        if phases[step] == "dwell" and step and phases[step - 1] in ("shear", "unload"):
            phases[step] = phases[step - 1]
    zero = [
        ("zero", t, -CLEAR_MM, np.nan, f"{press.name}_zero.png" if t == 0 else "", 0.0, 0.0) for t in ZERO_S
    ]
    shears = cell.shears_mm or ((0.0, 0.0),) * len(steps)
    times, names = path_times(cell), [f"{press.name}_step{step:02d}.png" for step in steps]
    course = [(phases[k], times[k], cell.depths_mm[k], SETTLE_S, names[k], *shears[k]) for k in steps]
    columns = ["phase", "time_s", "depth_mm", "dwell_s", "image", "shear_x_mm", "shear_y_mm"]
    rows = pd.DataFrame(zero + course, columns=columns)
    on_sensor = [np.zeros(3)] * len(zero) + [truth.deeper(step, deeper_mm)[1] for step in steps]
    return _described(rows, press, bench), np.array(on_sensor)


def _described(rows: pd.DataFrame, press: Press, bench: Bench) -> pd.DataFrame:
    """Return rows of an indentation with its name, and positions and times as its stage and clock report them."""
    away = rows[["shear_x_mm", "shear_y_mm"]].to_numpy() if "shear_x_mm" in rows else np.zeros((len(rows), 2))
    stage = sensor_to_stage(away + [press.cell.x_mm, press.cell.y_mm], bench.session.stage_to_sensor)
    rows = rows.assign(
        press=press.name, cell=press.cell.name, order=press.order, speed_mm_per_s=SPEED_MM_PER_S
    )
    rows["x_mm"], rows["y_mm"] = np.round(stage, 4).T + 0.0
    rows["time_s"] = (rows["time_s"] + press.start_s).round(3)
    rows["dwell_s"] = rows["dwell_s"].round(3)
    return rows


def read_force(on_sensor: np.ndarray, bench: Bench, rng: np.random.Generator) -> np.ndarray:
    """Return what the force sensor shows (R, 3) [N]: turned to its axes and body, with offset, noise and resolution."""
    sign = -1.0 if bench.session.acts_on == "indenter" else 1.0
    # axes^T F: back to the recorded axes
    recorded = sign * on_sensor @ np.asarray(bench.session.axes, dtype=float)
    noisy = recorded + bench.offset_N + rng.normal(0, bench.lab.force.noise_N, size=recorded.shape)
    step = np.array(bench.lab.force.resolution_N)
    return np.round(np.rint(noisy / step) * step, 9) + 0.0


def _bench(lab: VirtualLab, lab_session: VirtualSession, study: Study) -> Bench:
    particles = place_particles(lab.particles, study.sensor, lab.serial)
    lab = lab.model_copy(update={"imaging": focused(lab.imaging, particles)})
    untouched = _seen(lab, particles)
    offset = np.random.default_rng([lab_session.seed, 1]).normal(0, lab.force.offset_N)
    return Bench(lab, lab_session, particles, untouched, offset)


def _seen(lab: VirtualLab, centres: np.ndarray) -> np.ndarray:
    """Return what the lab's camera shows, noise-free, with its particles or dots at centres (P, 3) [mm]."""
    particles = lab.particles
    return picture(lab.camera, lab.imaging, centres, particles.diameter_mm, particles.dots is not None)


def _record_cell(
    bench: Bench, study: Study, truth_folder: Path, images: Path, presses: list[Press]
) -> list[pd.DataFrame]:
    """Write the images of one site's indentations and return their rows."""
    planned = presses[0].cell
    cell = read_truth(truth_folder, planned)
    truth: Motion | PathMotion
    if planned.follows_a_path:
        truth = path_motion(cell, bench.particles)
    else:
        truth = true_motion(cell, planned, bench.particles, study.sensor.width_x_mm)
    return [_record_press(bench, truth, images, press) for press in presses]


def drawn_contact_point(
    lab: VirtualLab, lab_session: VirtualSession, press: Press
) -> tuple[float, np.random.Generator]:
    """Return by how much [mm] an indentation is deeper than commanded, and where its further noise is drawn from."""
    rng = np.random.default_rng([lab_session.seed, 2, press.order])
    return rng.normal(0, lab.force.contact_point_scatter_mm), rng


def _record_press(bench: Bench, truth: Motion | PathMotion, images: Path, press: Press) -> pd.DataFrame:
    lab = bench.lab
    deeper_mm, rng = drawn_contact_point(lab, bench.session, press)

    def drawn(displacement: np.ndarray) -> np.ndarray:
        return _seen(lab, bench.particles + displacement)

    touched: Iterator[np.ndarray]
    if isinstance(truth, PathMotion):
        rows, on_sensor = path_rows(press, truth, deeper_mm, bench)
        touched = (drawn(truth.deeper(step, deeper_mm)[0]) for step in range(len(truth.depth_mm)))
    else:
        rows, on_sensor = press_rows(press, truth, deeper_mm, bench)
        touched = repeat(drawn(truth.displacement(max(press.depth_mm + deeper_mm, 0.0))))
    for phase, image in zip(rows["phase"], rows["image"]):
        if image:
            seen = bench.untouched if phase == "zero" else next(touched)
            _write_image(images / image, expose(seen, lab.imaging, rng, bench.exposure(press)))
    rows[FORCE] = read_force(on_sensor, bench, rng)
    return rows[[*COLUMNS, *FORCE, "image"]]


def _write_image(path: Path, image: np.ndarray) -> None:
    if not cv2.imwrite(str(path), image, PNG):
        raise VirtualLabError(f"{path}: cannot be written; is the disk full?")


def _refuse_real(folder: Path) -> None:
    """Raise VirtualLabError unless a folder is absent, empty or a synthetic session: measured data is never replaced."""
    if not any(path.is_file() and not path.name.startswith(".") for path in folder.rglob("*")):
        return
    described, readme = folder / "session.yaml", folder / "README.txt"
    if described.is_file():
        made_up = load_session(described).synthetic
    else:
        made_up = readme.is_file() and readme.read_text(encoding="utf-8").startswith("SYNTHETIC")
    if not made_up:
        raise VirtualLabError(
            f"{folder}: holds files that are not a synthetic session; name another folder or session"
        )
