"""What a session of the virtual lab would have recorded without any error of camera, flow and labels."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import distance_transform_edt

from gelforge.config import Camera, Study, VirtualLab, VirtualSession
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.symmetry import transform_bins
from gelforge.recording.features import flow_features
from gelforge.recording.optics.camera import project
from gelforge.virtual_lab.imaging import discs
from gelforge.virtual_lab.particles import VirtualLabError, place_particles, true_motion
from gelforge.virtual_lab.session import Press, drawn_contact_point, random_presses, session_cells
from gelforge.virtual_lab.true_solutions import TRUTH, read_truth


@dataclass(frozen=True)
class TruePress:
    """One recorded indentation as it was."""

    feature: np.ndarray  # (2 m,) of a camera and a flow without error
    bin_force_N: np.ndarray  # (B, 3) on the sensor, at the depth that was reached
    contact_point_bin_N: np.ndarray  # (B, 3) how much of it the error of the contact point makes


def true_presses(
    study: Study,
    lab: VirtualLab,
    cells: Mapping[str, PlannedCell],
    truth_folder: str | Path,
    recorded: Iterable[tuple[str, str, str]],
) -> Iterator[tuple[tuple[str, str], TruePress]]:
    """Yield session and indentation, and the truth of each, site by site.

    Parameters
    ----------
    study : Study
        Sensor and features.
    lab : VirtualLab
        That recorded the indentations.
    cells : mapping of str to PlannedCell
        Sites of the plan.
    truth_folder : str or Path
        Holds the true solutions <cell>.h5.
    recorded : iterable of (str, str, str)
        Session, indentation and site of each.

    Yields
    ------
    tuple of str
        Session and indentation.
    TruePress
        Feature, and forces on bins [N].

    Raises
    ------
    VirtualLabError
        For indentations that this virtual lab has not made.
    """
    made = _made_presses(lab, cells)
    wanted = sorted(set(recorded), key=lambda press: press[2])
    for session, press, name in wanted:
        if (session, press) not in made or made[session, press][1].cell.name != name:
            raise VirtualLabError(
                f"session {session}: indentation {press} of site {name} is none of this virtual lab's; record the session"
                " again (gelforge virtual-session)"
            )
    particles = place_particles(lab.particles, study.sensor, lab.serial)
    view = View.of(lab.camera, particles, lab.particles.diameter_mm)
    for name, presses in groupby(wanted, key=lambda press: press[2]):
        cell = read_truth(Path(truth_folder), cells[name], [*TRUTH, "bin_force_N"])
        motion = true_motion(cell, cells[name], particles, study.sensor.width_x_mm)
        bins = true_bins(cell, cells[name], study.sensor.bins.nx)
        for session, press, _ in presses:
            lab_session, motions = made[session, press]
            deeper_mm, _ = drawn_contact_point(lab, lab_session, motions)
            depth_mm = max(motions.depth_mm + deeper_mm, 0.0)
            flow = view.flow(particles + motion.displacement(depth_mm))
            feature = flow_features(flow, study.features.regions, study.features.moved_px)
            force = bins(depth_mm)
            yield (session, press), TruePress(feature, force, force - bins(motions.depth_mm))


def _made_presses(
    lab: VirtualLab, cells: Mapping[str, PlannedCell]
) -> dict[tuple[str, str], tuple[VirtualSession, Press]]:
    """Return what every indentation of the virtual lab is, by session and name."""
    shared_out = session_cells(lab, cells)
    return {
        (one.session, press.name): (one, press)
        for one in lab.sessions
        for press in random_presses(one, [cells[name] for name in shared_out[one.session]])
    }


def true_bins(cell: Cell, planned: PlannedCell, bins: int) -> PchipInterpolator:
    """Return the true force per bin: depth [mm] -> (B, 3) [N], while loading; bins: along one side.

    Piecewise cubic in depth without overshoot from zero at depth 0, as the motion of the particles.
    """
    load = np.array([str(phase) == "load" for phase in cell.attributes["phases"]])
    force = cell.arrays["bin_force_N"][load]
    if planned.symmetry is not None:
        force = transform_bins(planned.symmetry, force, bins)
    depth = np.concatenate([[0.0], cell.arrays["depth_mm"][load]])
    return PchipInterpolator(depth, np.concatenate([np.zeros_like(force[:1]), force]))


@dataclass(frozen=True)
class View:
    """Which particle each pixel of the reference frame shows: a flow without error follows that one."""

    camera: Camera
    pixels: np.ndarray  # (P, 2) of the undeformed particles
    shown: np.ndarray  # (H, W) index of the particle

    @classmethod
    def of(cls, camera: Camera, particles: np.ndarray, diameter_mm: float) -> View:
        """Return the view of undeformed particles (P, 3) [mm]; a pixel between them has the nearest one shown."""
        pixels, distance, radius = discs(camera, particles, diameter_mm)
        shown = np.full((camera.height_px, camera.width_px), -1)
        for p in np.argsort(-distance, kind="stable"):  # nearer ones cover farther ones
            _cover(shown, pixels[p], radius[p], p)
        if (shown < 0).all():
            raise VirtualLabError("the virtual camera sees no particle; correct its pose")
        nearest = distance_transform_edt(shown < 0, return_distances=False, return_indices=True)
        return cls(camera, pixels, shown[tuple(nearest)])

    def flow(self, moved: np.ndarray) -> np.ndarray:
        """Return the displacement (H, W, 2) [px] float32 of the reference frame's pixels, the particles at moved (P, 3)."""
        there, _ = project(self.camera, moved)
        return (there - self.pixels).astype(np.float32)[self.shown]


def _cover(shown: np.ndarray, centre: np.ndarray, radius: float, value: int) -> None:
    """Write a value on the pixels (H, W) whose middles lie in a disc about centre (u, v)."""
    u, v = centre
    rows = np.arange(max(0, int(np.ceil(v - radius))), min(shown.shape[0], int(np.floor(v + radius)) + 1))
    columns = np.arange(max(0, int(np.ceil(u - radius))), min(shown.shape[1], int(np.floor(u + radius)) + 1))
    inside = (rows[:, None] - v) ** 2 + (columns - u) ** 2 <= radius**2
    shown[rows[:, None], columns] = np.where(inside, value, shown[rows[:, None], columns])
