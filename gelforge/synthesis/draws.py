"""The presses that a synthesis solves: sites of straight presses, and drawn paths, each by its number."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gelforge.config import ConfigError, Indenter, Study, given
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import check_inside

PATH = "path"  # beginning of the names of drawn paths

# What networks trained on such draws err by: `python benchmarks/transfer.py`:
TRIES = 200  # until one fits the sensor
# Friction is followed step by step. Below the sizes of elements under the contact; benchmarks/transfer.py prints what
# networks trained on such paths err by.
SHEAR_STEP_MM, TILT_STEP_DEG, TWIST_STEP_DEG = 0.2, 1.0, 2.0
# Two balls of 4 to 6 mm about the 10 mm of the article (Sferrazza et al. 2019): benchmarks/transfer.py draws them.
PAIR_RADIUS_MM = (2.0, 3.0)
# A blunt edge, longer than the gel is high, rounded over two elements; networks trained on it are judged by
# benchmarks/transfer.py.
EDGE_WIDTH_MM, SHAFT_MM, ROUNDING_MM = 2.0, 12.0, 0.5
# Of the deepest depth: the least is a contact of some nodes, and steps are small where the contact grows fast.
# benchmarks/synthesis.py prints the error between them.
SITE_DEPTHS = (0.02, 0.05, 0.1, 0.175, 0.275, 0.4, 0.55, 0.7, 0.85, 1.0)


@dataclass(frozen=True)
class Solution:
    """A press that is solved once: its path, and the study with its indenter."""

    kind: str  # site, or the indenter of a path: own, ball, punch, edge, pair or mesh
    planned: PlannedCell
    study: Study


def solution_count(study: Study) -> int:
    """Return how many indentations a study's synthesis solves: sites first, then paths.

    Parameters
    ----------
    study : Study
        With `synthesis`.

    Returns
    -------
    int
        Numbers from 0 up to it are those of `solution`.

    Raises
    ------
    ConfigError
        For a study without `synthesis`.
    """
    return len(site_places(study)) + given(study.synthesis, "synthesis").paths


def shard_count(study: Study) -> int:
    """Return how many files the training rows of a study are written to.

    Parameters
    ----------
    study : Study
        With `synthesis`.

    Returns
    -------
    int
        At least 1.

    Raises
    ------
    ConfigError
        For a study without `synthesis`.
    """
    synthesis = given(study.synthesis, "synthesis")
    return math.ceil(synthesis.rows / synthesis.rows_per_shard)


def solution(study: Study, number: int) -> Solution:
    """Return the solved indentation of a number; the same for the same study, seed and number.

    Parameters
    ----------
    study : Study
        With `synthesis`.
    number : int
        From 0, below `solution_count`.

    Returns
    -------
    Solution
        Study and planned site.

    Raises
    ------
    ConfigError
        Where no draw fits the sensor, or a site is too deep for it.
    """
    places = site_places(study)
    if number < len(places):
        return _site(study, places[number], number)
    return drawn_path(study, number - len(places))


def site_places(study: Study) -> np.ndarray:
    """Return the positions of the solved sites: denser towards the walls; of mirror images, one.

    Parameters
    ----------
    study : Study
        With `synthesis`.

    Returns
    -------
    numpy.ndarray
        (n, 2) [mm] in the sensor frame; n is 0 where no straight indentation is required.

    Raises
    ------
    ConfigError
        For a study without `synthesis`.
    """
    synthesis, sensor = given(study.synthesis, "synthesis"), study.sensor
    if not (synthesis.classes.straight or synthesis.classes.light):
        return np.empty((0, 2))
    # sites lie denser towards the walls, whose distance changes forces there
    shares = np.linspace(0, 1, synthesis.sites) ** 1.3
    margin, widths = synthesis.margin_mm, (sensor.width_x_mm, sensor.width_y_mm)
    half = [margin + (w / 2 - margin) * shares for w in widths]
    if study.has_symmetry_of_square:
        places = [(x, y) for i, y in enumerate(half[1]) for x in half[0][: i + 1]]
    else:
        lines = [np.concatenate([h, w - h[-2::-1]]) for h, w in zip(half, widths)]
        places = [(x, y) for y in lines[1] for x in lines[0]]
    return np.round(np.array(places), 4)


def _site(study: Study, place: np.ndarray, number: int) -> Solution:
    deepest = given(study.synthesis, "synthesis").depth_mm[1]
    depths = tuple(round(share * deepest, 6) for share in SITE_DEPTHS)
    planned = PlannedCell(f"site{number:05d}", float(place[0]), float(place[1]), depths)
    solved = _with(study, study.indenter)
    check_inside({planned.name: planned}, solved)
    return Solution("site", planned, solved)


def drawn_path(study: Study, number: int) -> Solution:
    """Return the drawn path of a number; draws that the sensor cannot take (too deep, off its edge) are drawn again."""
    synthesis = given(study.synthesis, "synthesis")
    rng = np.random.default_rng([synthesis.seed, number])
    last = None
    for _ in range(TRIES):
        kind, indenter = _indenter(rng, study)
        turns = indenter.kind not in ("sphere", "several")  # a tilted ball is the same ball
        planned = _path(rng, study, f"{PATH}{number:05d}", turns)
        drawn = _with(study, indenter)
        try:
            check_inside({planned.name: planned}, drawn)
        except ConfigError as error:
            last = error
            continue
        return Solution(kind, planned, drawn)
    raise ConfigError(
        f"synthesis: path {number}: none of {TRIES} draws fits the sensor ({last}); make depth_mm, margin_mm or the "
        "shapes smaller"
    )


def path_number(name: str) -> int:
    """Return the number of a drawn path from its name."""
    return int(name.removeprefix(PATH))


def _with(study: Study, indenter: Indenter) -> Study:
    mechanics = {"error_bars": False, "store_displacement": True, "sensitivities": []}
    return study.with_values({"indenter": indenter, "mechanics": mechanics, "plan": {"symmetry": "none"}})


def _indenter(rng: np.random.Generator, study: Study) -> tuple[str, Indenter]:
    shapes = given(study.synthesis, "synthesis").shapes
    kinds = ("own", "ball", "punch", "edge", "pair", "mesh")
    weights = np.array([getattr(shapes, kind) for kind in kinds])
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    angle = float(rng.uniform(0, 180))
    if kind == "own":
        return kind, study.indenter
    if kind == "ball":
        return kind, Indenter(kind="sphere", radius_mm=_within(rng, shapes.ball_radius_mm))
    if kind == "punch":
        radius = _within(rng, shapes.punch_radius_mm)
        shaft = {"length_mm": SHAFT_MM, "edge_radius_mm": ROUNDING_MM}
        return kind, Indenter(kind="cylinder", radius_mm=radius, **shaft)
    if kind == "edge":
        size = [_within(rng, shapes.edge_length_mm), EDGE_WIDTH_MM, SHAFT_MM]
        turned = [0.0, 0.0, angle]
        return kind, Indenter(kind="box", size_mm=size, edge_radius_mm=ROUNDING_MM, orientation_deg=turned)
    if kind == "pair":
        half = _within(rng, shapes.pair_gap_mm) / 2
        x, y = half * math.cos(math.radians(angle)), half * math.sin(math.radians(angle))
        balls = [{"kind": "sphere", "radius_mm": _within(rng, PAIR_RADIUS_MM)} for _ in range(2)]
        parts = [balls[0] | {"offset_mm": [-x, -y, 0.0]}, balls[1] | {"offset_mm": [x, y, 0.0]}]
        return kind, Indenter(kind="several", parts=parts)
    file = shapes.files[int(rng.integers(len(shapes.files)))]
    return kind, Indenter(kind="mesh", file=file, orientation_deg=[0.0, 0.0, 2 * angle])


def _path(rng: np.random.Generator, study: Study, name: str, turns: bool) -> PlannedCell:
    """Return a path: down in even steps, then sideways, tilted or twisted, then up, as drawn.

    turns: whether a tilt says anything.
    """
    synthesis, sensor = given(study.synthesis, "synthesis"), study.sensor
    margin = synthesis.margin_mm
    x, y = (round(float(rng.uniform(margin, w - margin)), 4) for w in (sensor.width_x_mm, sensor.width_y_mm))
    deepest, count = _within(rng, synthesis.depth_mm), synthesis.steps
    none = (0.0, 0.0)
    steps = [("load", deepest * (k + 1) / count, none, none, 0.0) for k in range(count)]
    if rng.random() < synthesis.sheared:
        away = _direction(rng, _within(rng, synthesis.shear_mm))
        steps += [("shear", deepest, part, none, 0.0) for part in _parts(away, SHEAR_STEP_MM)]
    elif turns and rng.random() < synthesis.tilted:
        tilt = _direction(rng, _within(rng, synthesis.tilt_deg))
        steps += [("tilt", deepest, none, part, 0.0) for part in _parts(tilt, TILT_STEP_DEG)]
    elif synthesis.twisted and rng.random() < synthesis.twisted:  # nothing is drawn where none is asked for
        twist = float(rng.choice([-1.0, 1.0])) * _within(rng, synthesis.twist_deg)
        steps += [("twist", deepest, none, none, part) for part, _ in _parts((twist, 0.0), TWIST_STEP_DEG)]
    if rng.random() < synthesis.unloaded:
        *_, shear, tilt, twist = steps[-1]
        steps += [("unload", deepest * share, shear, tilt, twist) for share in (0.75, 0.5, 0.25)]
    phases, depths, shears, tilts, twists = zip(*steps)
    moved, tilted = any(map(any, shears)), any(map(any, tilts))
    if set(phases) == {"load"}:
        return PlannedCell(name, x, y, depths)
    shears, tilts = shears if moved else (), tilts if tilted else ()
    twists = twists if any(twists) else ()
    return PlannedCell(
        name, x, y, depths, phases=phases, shears_mm=shears, tilts_deg=tilts, twists_deg=twists
    )


def _parts(end: tuple[float, float], step: float) -> list[tuple[float, float]]:
    count = max(1, math.ceil(math.hypot(*end) / step - 1e-9))
    return [(end[0] * k / count, end[1] * k / count) for k in range(1, count + 1)]


def _direction(rng: np.random.Generator, length: float) -> tuple[float, float]:
    angle = float(rng.uniform(0, 2 * math.pi))
    return round(length * math.cos(angle), 6), round(length * math.sin(angle), 6)


def _within(rng: np.random.Generator, least_and_greatest) -> float:
    return round(float(rng.uniform(*least_and_greatest)), 4)
