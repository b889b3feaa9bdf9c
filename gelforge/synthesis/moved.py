"""Solved presses at other places: every step of a solved path, moved and turned.

Far from walls a path goes to any place, at any angle. Nearer to a wall it keeps its distance from the wall, and is turned by
the symmetries of the sensor only. What the walls change meanwhile is known of straight presses of the study's own indenter,
which are interpolated: of its paths the increments over the straight press are moved, and of other indenters the forces are
scaled as those of the straight press change.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from gelforge.config import Study, given
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.sensor.symmetry import D4, inverse, transform_points
from gelforge.interpolation.nodal_forces import NodalForces
from gelforge.synthesis.drawn_press import DrawnPress, merged
from gelforge.synthesis.frame import MovingFrame, displaced
from gelforge.synthesis.straight import StraightPresses

# Distance from the sides, over the sensor's height, beyond which a path goes anywhere (benchmarks/synthesis.py prints
# the errors near sides).
FREE_HEIGHTS = 1.5
# Nearer to a side, it is moved by at most this share of its distance from it (benchmarks/synthesis.py prints the
# errors near sides).
KEPT_SHARE = 0.05


class MovedPresses:
    """The steps of solved paths at drawn places and directions.

    Parameters
    ----------
    study : Study
        The study whose sensor is pressed.
    cells : sequence of Cell
        The solved paths with the gel's displacement; those without a solved step are left out.
    same_indenter : sequence of bool
        Of each path, whether the study's own indenter presses.
    straight : StraightPresses, optional
        Straight presses of the study's own indenter, which know the walls; without them moved presses stay as solved.
    """

    def __init__(
        self,
        study: Study,
        cells: Sequence[Cell],
        same_indenter: Sequence[bool],
        straight: StraightPresses | None = None,
    ):
        self.sensor, self.straight = study.sensor, straight
        self.frame = MovingFrame(study.sensor, given(study.synthesis, "synthesis").particles)
        kept = [k for k, cell in enumerate(cells) if len(cell.arrays["depth_mm"])]
        self.cells, self.own = [cells[k] for k in kept], [same_indenter[k] for k in kept]
        self._forces = [NodalForces.of(cell) for cell in self.cells]
        # a turned edge must not reach over a side
        self._reach = [np.linalg.norm(forces.offset_mm, axis=1).max(initial=0.0) for forces in self._forces]
        self._width = np.array([self.sensor.width_x_mm, self.sensor.width_y_mm])
        self.free_mm = FREE_HEIGHTS * self.sensor.height_mm
        self._round = study.indenter.is_upright_and_round
        self._symmetric = study.sensor_has_symmetry_of_square
        self._field = cache(lambda number: self.frame.field(self.cells[number]))
        self._base = cache(self._straight_press)
        self._push_at_source = cache(
            lambda number, step: self._push(self._source(number), self._depth(number, step))
        )

    def draw(self, rng: np.random.Generator) -> DrawnPress:
        """Return a drawn step of a drawn path, moved and turned."""
        number = int(rng.integers(len(self.cells)))
        step = int(rng.integers(len(self.cells[number].arrays["depth_mm"])))
        turns = not self.own[number] or self._round  # an indenter that is turned is another one
        source, margin = self._source(number), max(self.free_mm, self._reach[number])
        if (np.minimum(source, self._width - source) >= margin).all():
            angle = float(rng.uniform(0, 2 * np.pi)) if turns else 0.0
            return self.turned(number, step, rng.uniform(margin, self._width - margin), angle)
        symmetry = str(rng.choice(list(D4))) if self._symmetric and turns else "identity"
        image = transform_points(symmetry, source, self._width[0])
        place = np.array([_moved_along(c, w, margin, rng) for c, w in zip(image, self._width)])
        return self.mirrored(number, step, place, symmetry)

    def turned(self, number: int, step: int, place: np.ndarray, angle: float) -> DrawnPress:
        """Return a step of a path at a place (2,) [mm], turned by an angle [rad]; both places are far from walls."""
        matrix = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        source = self._source(number)

        def at_source(particles: np.ndarray) -> np.ndarray:
            local = particles.copy()
            local[:, :2] = (particles[:, :2] - place) @ matrix + source  # beyond the gel: as at its border
            return self.frame.index(local, source)

        return self._press(number, step, place, matrix, at_source)

    def mirrored(self, number: int, step: int, place: np.ndarray, symmetry: str) -> DrawnPress:
        """Return a step of a path carried by a symmetry, at a place (2,) [mm] near its image's."""
        back = inverse(symmetry)
        at = transform_points(back, place, self._width[0])

        def at_source(particles: np.ndarray) -> np.ndarray:
            return self.frame.index(transform_points(back, particles, self._width[0]), at)

        return self._press(number, step, place, D4[symmetry].astype(float), at_source)

    def _press(self, number: int, step: int, place: np.ndarray, matrix: np.ndarray, at_source) -> DrawnPress:
        """Return a step about a place, turned by a matrix (2, 2); at_source: particles to grid coordinates of its field."""
        cell, forces = self.cells[number], self._forces[number]
        depth, phase = self._depth(number, step), str(cell.attributes["phases"][step])
        one = NodalForces(forces.offset_mm, forces.half_mm, forces.force_N[[step]]).turned(matrix)
        field, here, source = self._field(number)[step], None, self._source(number)
        if self.straight and self.straight.reaches(place, depth) and self.straight.reaches(source, depth):
            if self.own[number]:
                base, base_field = self._base(number, step)
                here = self.straight.at(place, depth)
                field = field - base_field
                one = merged([(1.0, one), (-1.0, base.turned(matrix)), (1.0, here.forces)])
            else:
                one = merged([(self._push(place, depth) / self._push_at_source(number, step), one)])

        def moved(particles: np.ndarray) -> np.ndarray:
            shift = displaced(field, at_source(particles))
            shift[:, :2] = shift[:, :2] @ matrix.T
            return shift + here.moved(particles) if here else shift

        return DrawnPress(place, depth, phase, one, moved)

    def _straight_press(self, number: int, step: int) -> tuple[NodalForces, np.ndarray]:
        """Return the straight press of the study's own indenter where a path was solved, as deep as its step."""
        assert self.straight is not None
        return self.straight.state(self._source(number), self._depth(number, step))

    def _push(self, place: np.ndarray, depth: float) -> float:
        """Return the vertical force [N] of the straight press of the study's own indenter."""
        assert self.straight is not None
        return float(self.straight.force(place, depth).force_N[0, :, [2, 5]].sum())

    def _depth(self, number: int, step: int) -> float:
        return float(self.cells[number].arrays["depth_mm"][step])

    def _source(self, number: int) -> np.ndarray:
        return np.array([self.cells[number].attributes["x_mm"], self.cells[number].attributes["y_mm"]])


def _moved_along(at: float, width: float, margin: float, rng: np.random.Generator) -> float:
    """Return a coordinate for one of a solved press: anywhere far from sides, else about as near to its side."""
    side = min(at, width - at)
    if side >= margin:
        return float(rng.uniform(margin, width - margin))
    return at + float(rng.uniform(-1, 1)) * KEPT_SHARE * side
