"""Forces anywhere between the solved places and depths, of the base and of the finite-element effects.

The force at the middle is a cubic spline in logarithms of depth and force. Its ratio at other places and horizontal over
vertical force are surfaces over the face. Effects are logarithms of ratios of vertical forces, and changes of horizontal
over vertical force.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from . import solves
from .sensors import SENSORS, SMALL, Sensor
from .solves import BETWEEN, CHECKED, Solutions, read_solutions
from .surface import Surface

DEGREE, FLAT_DEGREE, AREA_DEGREE, EFFECT_DEGREE = 3, 4, 3, 2  # of the polynomials over depth
THROUGH_ALL = {
    "friction": 4,
    "slipping": 4,
    "smooth": 4,
}  # curves that turn twice, in both codes alike: through all solved depths


@dataclass(frozen=True)
class Change:
    """What an effect does, at coefficients of place (4) and depth: log ratio and horizontal over vertical."""

    log_ratio: np.ndarray  # (4, p)
    horizontal: np.ndarray  # (4, p)

    def at(self, xy: np.ndarray, depth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return log ratio (R,) and change of (Fx, Fy) / Fz (R, 2) at places (R, 2) from the middle and depths (R,) [mm]."""
        powers = np.vander(depth, self.log_ratio.shape[1], increasing=True)
        s, t = xy.T**2
        ratio = np.einsum("rm,mp,rp->r", _even_basis(s, t), self.log_ratio, powers)
        x = np.einsum("rm,mp,rp->r", _odd_basis(s, t), self.horizontal, powers) * xy[:, 0]
        y = np.einsum("rm,mp,rp->r", _odd_basis(t, s), self.horizontal, powers) * xy[:, 1]
        return ratio, np.stack([x, y], axis=1)


@dataclass(frozen=True)
class LocalChange:
    """What a defect does at the plan's places near it; other places do not feel it."""

    places: np.ndarray  # (n, 2)
    log_ratio: np.ndarray  # (n, p)
    horizontal: np.ndarray  # (n, p, 2)

    def at(self, xy: np.ndarray, depth: np.ndarray, turns: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the same as `Change.at`, the defect turned by quarter turns about the middle."""
        turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), turns)
        away = np.linalg.norm(xy[:, None] - self.places @ turn.T, axis=2)
        near, observable = away.argmin(axis=1), away.min(axis=1) < 1.0
        powers = np.vander(depth, self.log_ratio.shape[1], increasing=True)
        ratio = np.einsum("rp,rp->r", self.log_ratio[near], powers) * observable
        flat = np.einsum("rpj,rp->rj", self.horizontal[near], powers) * observable[:, None]
        return ratio, flat @ turn.T


@dataclass(frozen=True)
class Library:
    """All that has been solved, ready to be evaluated; places are from the sensor's middle [mm]."""

    shape: tuple[np.ndarray, np.ndarray]  # (D,), (D,) log depth [mm] and log -Fz [N] at the middle, fine mesh
    vertical: Surface  # ratio of Fz to that
    horizontal: Surface  # Fx / Fz
    area: np.ndarray  # (p,) contact area / depth at the middle
    changes: dict[str, Change]
    defects: dict[tuple[str, str], LocalChange]
    sensor: Sensor = SMALL

    def base(self, xy: np.ndarray, depth: np.ndarray) -> np.ndarray:
        """Return the base forces (R, 3) [N] at places (R, 2) and depths (R,) [mm]; 0 above the surface."""
        d = np.maximum(depth, 1e-6)
        x, y = xy.T
        z = self.vertical.at(x, y, d) * self._middle(d)
        flat_x, flat_y = self.horizontal.at(x, y, d) * z, self.horizontal.at(y, x, d) * z
        return np.where((depth > 0)[:, None], np.stack([flat_x, flat_y, z], axis=1), 0.0)

    def _middle(self, d: np.ndarray) -> np.ndarray:
        """Return Fz (R,) [N] at the middle; below the least solved depth a power of the depth, as in Hertz's law."""
        spline = CubicSpline(*self.shape)
        first, at = self.shape[0][0], np.log(d)
        below = np.minimum(at - first, 0.0)
        return -np.exp(spline(np.maximum(at, first)) + spline(first, 1) * below)


def load_library(solutions: Solutions | None = None, sensor: Sensor = SMALL) -> Library:
    """Return a sensor's library of solutions, those kept where none are given; effects not all solved are left out."""
    solutions = read_solutions() if solutions is None else solutions
    changes = {}
    for name in sensor.effects:
        if all(solves.effect_setup(name, *o, sensor) in solutions for o in sensor.orbits):
            changes[name] = _change(name, solutions, sensor)
    if "slipping" in changes and "friction" in changes:
        changes["friction"] = _without_slip(changes["friction"], changes.pop("slipping"))
    defects = _defects(solutions) if sensor == SMALL else {}
    return Library(*_base_tables(solutions, sensor), changes, defects, sensor)


def load_libraries(names: Iterable[str]) -> dict[str, Library]:
    """Return the libraries of some sensors by name, of the solutions that are kept."""
    solutions = read_solutions()
    return {name: load_library(solutions, SENSORS[name]) for name in names}


def _defects(solutions: Solutions) -> dict[tuple[str, str], LocalChange]:
    """Return what the defects whose presses are all solved do."""
    defects = {}
    for name in solves.DEFECTS:
        pairs = {
            place: [
                [solves.defect_setup(name, place, x, y, there) for there in (True, False)] for x, y in touched
            ]
            for place, (_, touched) in solves.DEFECT_PLACES.items()
        }
        setups = [setup for own in pairs.values() for pair in own for setup in pair]
        if all(setup in solutions for setup in setups):
            for place, (_, touched) in solves.DEFECT_PLACES.items():
                defects[name, place] = _local(pairs[place], np.array(touched), solutions)
    return defects


def _without_slip(change: Change, twice: Change) -> Change:
    """Return Coulomb's friction from that with slip before sliding, and with twice the slip: it grows in proportion."""
    return Change(2 * change.log_ratio - twice.log_ratio, 2 * change.horizontal - twice.horizontal)


def convergence() -> list[dict]:
    """Return the base's vertical forces next to those of the fine mesh, where both are known."""
    rows, solutions = [], read_solutions()
    for place in CHECKED:
        if solves.fine_setup(*place) not in solutions:
            continue
        base, fine = solutions[solves.base_setup(*place)], solutions[solves.fine_setup(*place)]
        for d, a, b in zip(base.depths_mm, base.force_N[:, 2], fine.force_N[:, 2]):
            rows.append(
                {
                    "place": place,
                    "depth_mm": float(d),
                    "base_N": float(a),
                    "fine_N": float(b),
                    "ratio": float(b / a),
                }
            )
    return rows


def between() -> list[dict]:
    """Return the base's forces [N] between the places where it was solved: as the library gives them, and solved there.

    At the deepest depth of the presses; the library's Fz is that of the fine mesh.
    """
    solutions, depth = read_solutions(), 1.6
    library, rows = load_library(solutions), []
    for place in BETWEEN:
        if solves.base_setup(*place) not in solutions:
            continue
        solved = solutions[solves.base_setup(*place)]
        k = int(np.argmin(np.abs(solved.depths_mm - depth)))
        given = library.base(np.array([place]), np.array([depth]))[0]
        rows.append({"place": place, "depth_mm": depth, "given_N": given, "solved_N": solved.force_N[k]})
    return rows


def _base_tables(solutions: Solutions, sensor: Sensor) -> tuple:
    """Return shape, vertical, horizontal and area of a library.

    A place's ratio to the middle is smoothed over depth: nodes that come to touch make it jump by half a per cent.
    """
    curves = {place: solutions.without_slip(solves.base_setup(*place, sensor)) for place in sensor.triangle}
    middle, fine = curves[0.0, 0.0], solutions.without_slip(solves.fine_setup(0.0, 0.0, sensor))
    depths, nodes = middle.depths_mm, np.array(sensor.nodes)
    ratio, flat = np.empty((2, len(nodes), len(nodes), len(depths)))
    for i, a in enumerate(sensor.nodes):
        for j, b in enumerate(sensor.nodes):
            force = curves[max(a, b), min(a, b)].force_N
            ratio[i, j] = force[:, 2] / middle.force_N[:, 2]
            flat[i, j] = force[:, 0 if a >= b else 1] / force[:, 2]
    flat[0] = 0.0  # by symmetry
    vertical = Surface.through(nodes, depths, ratio, DEGREE)
    horizontal = Surface.through(nodes, depths, flat, FLAT_DEGREE, sign=-1)
    shape = np.log(depths), np.log(-fine.force_N[:, 2])
    area = np.linalg.pinv(np.vander(depths, AREA_DEGREE + 1, increasing=True)) @ (fine.area_mm2 / depths)
    return shape, vertical, horizontal, area


def _ratio(curve, base) -> tuple[np.ndarray, np.ndarray]:
    """Return log ratio (D,) and change of horizontal over vertical (D, 2) of a curve against the plain one."""
    F, F0 = curve.force_N, base.force_N
    return np.log(F[:, 2] / F0[:, 2]), F[:, :2] / F[:, 2:] - F0[:, :2] / F0[:, 2:]


def _change(name: str, solutions: Solutions, sensor: Sensor) -> Change:
    setups = [[solves.effect_setup(n, *o, sensor) for n in (name, "")] for o in sensor.orbits]
    # the small sensor's friction has its slip taken off by `_without_slip`
    of = solutions.without_slip if sensor.plain.friction else solutions.__getitem__
    found = [_ratio(*(of(setup) for setup in pair)) for pair in setups]
    depths = np.array(sensor.effect_depths)
    degree = THROUGH_ALL.get(name, EFFECT_DEGREE)
    fit = np.linalg.pinv(np.vander(depths, degree + 1, increasing=True))
    s, t = np.array(sensor.orbits).T ** 2
    log_ratio = np.linalg.solve(_even_basis(s, t), np.array([ratio @ fit.T for ratio, _ in found]))
    # Fx at the orbits away from the middle, and at (b, a) the Fy of the one between, (a, b)
    (_, axis, between, diagonal), (_, on_axis, beside, across) = sensor.orbits, found
    x, y = np.array([axis, between, diagonal, between[::-1]]).T
    flat = [on_axis[1][:, 0], beside[1][:, 0], across[1][:, 0], beside[1][:, 1]]
    values = np.array(flat) / x[:, None] @ fit.T
    return Change(log_ratio, np.linalg.solve(_odd_basis(x**2, y**2), values))


def _local(pairs, places, solutions: Solutions) -> LocalChange:
    fit = np.linalg.pinv(np.vander(np.array(SMALL.effect_depths), EFFECT_DEGREE + 1, increasing=True))
    found = [_ratio(*(solutions[setup] for setup in pair)) for pair in pairs]
    return LocalChange(
        places, np.array([fit @ ratio for ratio, _ in found]), np.array([fit @ flat for _, flat in found])
    )


def _even_basis(s, t) -> np.ndarray:
    return np.stack([np.ones_like(s), s + t, s * t, s**2 + t**2], axis=1)


def _odd_basis(s, t) -> np.ndarray:
    return np.stack([np.ones_like(s), s, t, s * t], axis=1)
