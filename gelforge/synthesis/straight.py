"""Straight presses of the study's own indenter at any place and depth between solved sites."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from gelforge.config import Study, given
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.paths.places import ROUNDING_MM
from gelforge.indentation.sensor.symmetry import D4, inverse, transform_points
from gelforge.interpolation.nodal_forces import NodalForces, ball_of, contact_width
from gelforge.interpolation.weights import depth_weights, nearest, place_weights
from gelforge.synthesis.drawn_press import DrawnPress, merged
from gelforge.synthesis.frame import MovingFrame, displaced, turned_field


class StraightPresses:
    """Displacement and forces between solved sites and depths, in coordinates that move with the indenter.

    Sites are weighted by radial functions that reproduce what is quadratic in the place, depths by a cubic with zero at
    the surface. The nodes that carry a depth's force lie as far apart as the contact of a ball is then wide.

    Parameters
    ----------
    study : Study
        The study whose indenter presses.
    cells : sequence of Cell
        The solved sites with the gel's displacement, all with the same depths; of sites that are mirror images of each
        other, one.
    """

    def __init__(self, study: Study, cells: Sequence[Cell]):
        self.sensor = study.sensor
        self.frame = MovingFrame(study.sensor, given(study.synthesis, "synthesis").particles)
        self.depths = np.concatenate([[0.0], cells[0].arrays["depth_mm"]])
        self._ball = ball_of(study.indenter)
        self._fields = [self.frame.field(cell) for cell in cells]
        self._forces = [NodalForces.of(cell) for cell in cells]
        self.symmetric = study.has_symmetry_of_square
        places = np.array([[cell.attributes["x_mm"], cell.attributes["y_mm"]] for cell in cells])
        self._images = self._with_images(places)
        self._places = np.array([place for _, _, place in self._images])
        self.low, self.high = self._places.min(axis=0), self._places.max(axis=0)

    def _with_images(self, places: np.ndarray) -> list[tuple[int, str, np.ndarray]]:
        """Return number, symmetry and place of every site and of its mirror images, each place once."""
        images: dict[tuple, tuple[int, str, np.ndarray]] = {}
        for number, place in enumerate(places):
            for name in D4 if self.symmetric else ("identity",):
                image = transform_points(name, place, self.sensor.width_x_mm)
                images.setdefault(tuple(np.round(image, 4)), (number, name, image))
        return list(images.values())

    @cached_property
    def _mirrored(self) -> list[NodalForces]:
        return [self._forces[number].mirrored(name) for number, name, _ in self._images]

    def reaches(self, place: np.ndarray, depth: float) -> bool:
        """Return whether a place (2,) [mm] and a depth [mm] lie among the solved ones."""
        inside = (place >= self.low - ROUNDING_MM).all() and (place <= self.high + ROUNDING_MM).all()
        return bool(inside and self.depths[1] - ROUNDING_MM <= depth <= self.depths[-1] + ROUNDING_MM)

    def at(self, place: np.ndarray, depth: float, without: int | None = None) -> DrawnPress:
        """Return the press at a place (2,) [mm] and a depth [mm]; see `state`."""
        forces, field = self.state(place, depth, without)

        def moved(particles: np.ndarray) -> np.ndarray:
            return displaced(field, self.frame.index(particles, place))

        return DrawnPress(place, depth, "load", forces, moved)

    def state(
        self, place: np.ndarray, depth: float, without: int | None = None
    ) -> tuple[NodalForces, np.ndarray]:
        """Return nodal forces and displacement field at a place and depth.

        Parameters
        ----------
        place : ndarray of shape (2,)
            In mm.
        depth : float
            In mm.
        without : int, optional
            Number of a solved site to be left out with its images, to see what the others predict there.

        Returns
        -------
        forces : NodalForces
            Of one state, about the place [N].
        field : ndarray of shape (nx, ny, nz, 3)
            Displacement on the frame's grid about the place [mm].

        Raises
        ------
        ValueError
            If place or depth lie outside the solved ones.
        """
        back, pairs, loaded = self._between(place, depth, without)
        field = turned_field(back, self._field(pairs, loaded))
        return self._nodes(depth, pairs, loaded).mirrored(back), field

    def force(self, place: np.ndarray, depth: float) -> NodalForces:
        """Return the nodal forces of `state` alone; the field is most of its work."""
        back, pairs, loaded = self._between(place, depth)
        return self._nodes(depth, pairs, loaded).mirrored(back)

    def _between(self, place: np.ndarray, depth: float, without: int | None = None) -> tuple[str, list, list]:
        """Return what carries the first octant to the place, and the weighted sites and depths around its image there."""
        if not self.reaches(place, depth):
            raise ValueError(
                f"place {place.tolist()} mm and depth {depth:g} mm lie outside the solved {self.low.tolist()} to "
                f"{self.high.tolist()} mm and {self.depths[1]:g} to {self.depths[-1]:g} mm"
            )
        # a press and its image are one: in the first octant few fields have to be turned
        turn = self._to_first_octant(place)
        at = transform_points(turn, place, self.sensor.width_x_mm)
        usable = [k for k, (number, _, _) in enumerate(self._images) if number != without]
        chosen = np.array(usable)[nearest(self._places[usable], at)]
        weights = place_weights(self._places[chosen], at)
        pairs = [(int(k), float(w)) for k, w in zip(chosen, weights) if abs(w) > 1e-4]
        numbers, along = depth_weights(self.depths, min(depth, self.depths[-1]))
        loaded = [(n, float(w)) for n, w in zip(numbers, along) if n > 0]  # nothing moves at depth zero
        return inverse(turn), pairs, loaded

    def _to_first_octant(self, place: np.ndarray) -> str:
        if not self.symmetric:
            return "identity"
        images = {name: transform_points(name, place, self.sensor.width_x_mm) for name in D4}
        middle = self.sensor.width_x_mm / 2 + ROUNDING_MM
        return next(n for n, p in images.items() if p[0] <= p[1] + ROUNDING_MM and p[1] <= middle)

    def _field(self, pairs, loaded) -> np.ndarray:
        depths = [number - 1 for number, _ in loaded]
        along = np.array([weight for _, weight in loaded], np.float32)
        total: np.ndarray = np.zeros(self._fields[0].shape[1:], np.float32)
        for k, weight in pairs:
            number, name, _ = self._images[k]
            field = np.tensordot(np.float32(weight) * along, self._fields[number][depths], 1)
            total += field if name == "identity" else turned_field(name, field)
        return total

    def _nodes(self, depth: float, pairs, loaded) -> NodalForces:
        """Return the nodal forces of every site and depth, weighted."""
        parts = []
        for number, along in loaded:
            scale = contact_width(self._ball, depth) / contact_width(self._ball, self.depths[number])
            for k, weight in pairs:
                nodes = self._mirrored[k]
                force = nodes.force_N[number - 1 : number]
                moved = NodalForces(scale * nodes.offset_mm, scale * nodes.half_mm, force)
                parts.append((weight * along, moved))
        return merged(parts)
