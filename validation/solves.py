"""The solutions that all cases share: the base at places all over the sensor, and effects of finite elements at four places.

They are kept in solutions.jsonl, one line each, so that a set can be made without solving anything. A press to one place
stands for its mirror images. Effects are solved on the coarse mesh and enter as ratios to the plain press on that same
mesh; the base has a finer mesh, and at two places a still finer one that says how far it is from it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from .pressed import COARSE, FINE, Ball, Curve, Setup, press
from .sensors import SENSORS, SMALL, Sensor

SOLUTIONS = Path(__file__).with_name("solutions.jsonl")
CHECKED = ((0.0, 0.0), (6.0, 0.0))  # where the base of the small sensor is solved on the fine mesh too
BETWEEN = (
    (4.1197, 1.7403),
    (5.6044, 6.3712),
    (5.75, 0.0),
    (6.2, 0.0),
)  # (4, 2) and (6, 6) of a grid turned by -3.66 degrees, and where the contact reaches the wall: to check what is between
# Where defects sit, from the middle; four turns of the plan bring them to other corners. And the places that feel them,
# the nearest first: up to 6 mm away.
DEFECT_PLACES = {
    "inner": (
        (3.0, 1.0),
        ((4.0, 2.0), (0.0, 0.0), (6.0, 0.0), (2.0, -4.0), (6.0, 6.0), (-2.0, 4.0), (0.0, 6.0)),
    )
}
DEFECTS: dict[str, dict] = {
    "void": {"radius_mm": 1.3, "factor": 0.02, "bulk": 1e-3, "z": -3.0},  # softer ones find no equilibrium
    "inclusion": {"radius_mm": 1.3, "factor": 20.0, "z": -3.0},
    "delamination": {"radius_mm": 2.5, "factor": 0.02, "z": -1.15, "film": True},
}


def base_setup(x: float, y: float, sensor: Sensor = SMALL) -> Setup:
    at = _at(sensor, x, y)
    return replace(at, depths_mm=sensor.depths, sizes=sensor.base_sizes)


def fine_setup(x: float, y: float, sensor: Sensor = SMALL) -> Setup:
    return replace(base_setup(x, y, sensor), sizes=FINE)


def effect_setup(name: str, x: float, y: float, sensor: Sensor = SMALL) -> Setup:
    """Return a press with an effect; "" is none, on the effects' mesh."""
    changed = sensor.effects[name] if name else {}
    return replace(_at(sensor, x, y), depths_mm=sensor.effect_depths, sizes=sensor.effect_sizes, **changed)


def _at(sensor: Sensor, x: float, y: float) -> Setup:
    x, y = sensor.solved(x, y)
    return replace(sensor.plain, x_mm=x, y_mm=y)


def defect_setup(name: str, place: str, x: float, y: float, there: bool = True) -> Setup:
    """Return a press of the small sensor next to a defect; without it, on the same mesh, where it is not there."""
    (dx, dy), _ = DEFECT_PLACES[place]
    keys = dict(DEFECTS[name])
    ball = Ball((dx, dy, keys.pop("z")), **keys)
    defect = ball if there else replace(ball, factor=1.0, bulk=None)
    return Setup(float(x), float(y), SMALL.effect_depths, COARSE, defect=defect)


def twice_slipping(setup: Setup) -> Setup:
    """Return a press with friction whose nodes slip twice as far before they slide: it tells what no slip would be."""
    return replace(setup, tangential=setup.tangential / 2)


def all_setups() -> Iterator[tuple[str, Setup]]:
    """Yield every solution that is needed, by name, the most needed first; some more than once."""
    for sensor in SENSORS.values():
        for name, setup in _of_sensor(sensor):
            yield f"{sensor.name}: {name}", setup
            if sensor.plain.friction and setup.friction:
                yield f"{sensor.name}: {name}, twice the slip", twice_slipping(setup)
    for place, (_, touched) in DEFECT_PLACES.items():
        for x, y in touched:
            for name in DEFECTS:
                yield f"{name} {place} ({x:g}, {y:g})", defect_setup(name, place, x, y)
                yield f"without {name} {place} ({x:g}, {y:g})", defect_setup(name, place, x, y, there=False)
    yield "fine (6, 0)", fine_setup(6.0, 0.0)
    for x, y in BETWEEN:
        yield f"between ({x:g}, {y:g})", base_setup(x, y)


def _of_sensor(sensor: Sensor) -> Iterator[tuple[str, Setup]]:
    for x, y in sensor.triangle:
        yield f"base ({x:g}, {y:g})", base_setup(x, y, sensor)
    for name in ("", *sensor.effects):
        for x, y in sensor.orbits:
            yield f"{name or 'plain'} ({x:g}, {y:g})", effect_setup(name, x, y, sensor)
    yield "fine (0, 0)", fine_setup(0.0, 0.0, sensor)


class Solutions:
    """Curves by the setup that they solve."""

    def __init__(self, curves: Mapping[str, Curve]):
        self._curves = dict(curves)

    def __contains__(self, setup: Setup) -> bool:
        return setup.key in self._curves

    def __getitem__(self, setup: Setup) -> Curve:
        if setup not in self:
            raise KeyError(
                f"a press at ({setup.x_mm:g}, {setup.y_mm:g}) mm has not been solved; "
                "run python -m validation solve"
            )
        return self._curves[setup.key]

    def without_slip(self, setup: Setup) -> Curve:
        """Return the curve of a setup; with friction that of no slip before nodes slide: forces follow it in proportion."""
        curve = self[setup]
        if not setup.friction:
            return curve
        twice = self[twice_slipping(setup)]
        return replace(
            curve, force_N=2 * curve.force_N - twice.force_N, area_mm2=2 * curve.area_mm2 - twice.area_mm2
        )


def read_solutions(path: Path = SOLUTIONS) -> Solutions:
    """Return the curves in a file; none where there is no file."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    found = {}
    for one in map(json.loads, lines):
        arrays = {name: np.array(one[name]) for name in ("depths_mm", "force_N", "area_mm2")}
        numbers = {name: one[name] for name in ("seconds", "unknowns", "iterations")}
        found[one["key"]] = Curve(**arrays, **numbers)
    return Solutions(found)


def line_of(setup: Setup, curve: Curve) -> str:
    """Return the line of a curve, with what it solves."""
    content = {"key": setup.key} | asdict(curve) | {"setup": asdict(setup)}
    return json.dumps(content, default=np.ndarray.tolist)


def solve_all(path: Path = SOLUTIONS, say: Callable[[str], None] = print, workers: int = 1) -> None:
    """Solve what is missing, `workers` presses side by side, and add it line by line to the file."""
    known, missing = read_solutions(path), {}
    for name, setup in all_setups():
        if setup not in known:
            missing.setdefault(setup.key, (name, setup))
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        running = {pool.submit(press, setup): (name, setup) for name, setup in missing.values()}
        for done in as_completed(running):
            (name, setup) = running[done]
            if done.exception() is not None:
                say(f"{name}: not solved: {done.exception()}")
                continue
            curve = done.result()
            with open(path, "a", encoding="utf-8") as file:
                file.write(line_of(setup, curve) + "\n")
            say(
                f"{name}: {curve.force_N[-1, 2]:.4f} N at {curve.depths_mm[-1]:g} mm, "
                f"{curve.unknowns} unknowns, {curve.iterations} iterations, {curve.seconds:.0f} CPU s"
            )
