"""Places of the sites between which labels are interpolated: nested lattices over a plan's region.

All are known before anything is solved: level 0 covers the region, every further level halves its spacing. Which of a
level's places are solved is decided when the level before is (gelforge/interpolation/levels.py); where they lie, and what
each is called, never changes.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from gelforge.config import ConfigError, Study, given
from gelforge.files import digest, source_digest
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.indenter_shapes import shape_of
from gelforge.indentation.sensor.symmetry import D4, transform_points

# Level of the finest lattice, 2^4 to the first spacing, which is at most the layers' height: 0.3 mm of 4.8 mm, and the
# elements under the contact are no finer (mechanics/meshes/mesh.py).
LAST = 4
FINEST = 2**LAST
# Of a site, where the plan's depths differ from site to site. Hertz's force is a cubic of the contact's radius, in whose
# even steps they lie: four would do for a half space (judgement).
DEPTHS = 10
NAME = re.compile(r"between_(\d{4})_(\d{4})")
Index = tuple[int, int]


@dataclass(frozen=True)
class Lattice:
    """A rectangle with its lattices; an Index counts the finest spacing along x and y."""

    low: tuple[float, float]  # corners [mm]
    high: tuple[float, float]
    parts: tuple[int, int]  # intervals along x and y on level 0
    depths_mm: tuple[float, ...]  # of every solved site
    width_mm: float | None  # of the square sensor whose symmetry holds; None: no symmetry

    @property
    def spacing_mm(self) -> float:
        """The larger spacing of level 0 [mm]."""
        return max((b - a) / max(n, 1) for a, b, n in zip(self.low, self.high, self.parts))

    @property
    def ends(self) -> Index:
        """The index of the upper corner."""
        return self.parts[0] * FINEST, self.parts[1] * FINEST

    def place(self, at: Index) -> np.ndarray:
        """Return the position (2,) [mm]."""
        low, high, ends = np.array(self.low), np.array(self.high), np.maximum(self.ends, 1)
        return np.round(low + (high - low) * np.array(at) / ends, 6)

    def level(self, number: int) -> list[Index]:
        """Return every place of a level and of those before."""
        step = FINEST >> number
        return [(i, j) for j in _every(step, self.ends[1]) for i in _every(step, self.ends[0])]

    def images(self, at: Index) -> list[Index]:
        """Return a place and its mirror images, each once."""
        if self.width_mm is None:
            return [at]
        n, (i, j) = self.ends[0], at
        return sorted({(x, y) for a, b in ((i, j), (j, i)) for x in (a, n - a) for y in (b, n - b)})

    def representatives(self, places: Iterable[Index]) -> list[Index]:
        """Return the places that are solved so that all of these are known: one of each that mirror into each other."""
        return sorted({self.images(at)[0] for at in places})

    def symmetry_to(self, source: Index, image: Index) -> str:
        """Return the name of the symmetry that carries one place to the other."""
        if source == image:
            return "identity"
        if self.width_mm is None:
            raise ValueError(f"{source} and {image}: a lattice without symmetry has no images")
        there, width = self.place(image), self.width_mm
        moved = {name: transform_points(name, self.place(source), width) for name in D4}
        return min(moved, key=lambda name: float(np.abs(moved[name] - there).max()))

    def corner(self, at: Index) -> bool:
        """Return whether nothing lies beyond a place along x nor along y: the others do not enclose it."""
        return all(k in (0, end) for k, end in zip(at, self.ends))

    def around(self, position: np.ndarray, number: int) -> list[Index]:
        """Return the places of the next level in the cell of a level that holds a position (2,) [mm]."""
        step = FINEST >> number
        low, high = np.array(self.low), np.array(self.high)
        share = (position - low) / np.where(high > low, high - low, 1.0) * self.ends
        first = [min(max(int(s // step) * step, 0), max(end - step, 0)) for s, end in zip(share, self.ends)]
        along = [_every(step // 2, min(step, end)) for end in self.ends]
        return [(first[0] + i, first[1] + j) for j in along[1] for i in along[0]]


def _every(step: int, end: int) -> range:
    return range(0, end + 1, step)


def name_of(at: Index) -> str:
    """Return the name of the file of a place of the lattice.

    Parameters
    ----------
    at : (int, int)
        Steps of the finest lattice along x and y.

    Returns
    -------
    str
        Such as "between_0004_0012".
    """
    return f"between_{at[0]:04d}_{at[1]:04d}"


def index_of(name: str) -> Index | None:
    """Return the place of the lattice that a name of a file says.

    Parameters
    ----------
    name : str
        Such as "between_0004_0012".

    Returns
    -------
    (int, int) or None
        Steps of the finest lattice along x and y; None for another name.
    """
    match = NAME.fullmatch(name)
    return (int(match[1]), int(match[2])) if match else None


def check_interpolation(study: Study) -> None:
    """Refuse to interpolate where forces do not move with the indenter from site to site. Raises ConfigError."""
    mechanics, effects = study.mechanics, study.mechanics.effects
    geometry = effects.geometry
    placed = [name for name in ("inclusions", "patches", "delaminations") if getattr(geometry, name)]
    interpolation = given(study.plan.interpolation, "plan.interpolation")
    kind, share = study.sensor.shape.kind, interpolation.tolerance is not None
    why_not = [
        (kind != "block", f"shape.kind: {kind}, whose surface differs from site to site"),
        (study.tetrahedra, "mechanics.mesh.elements: tetrahedra, whose corners carry no force of their own"),
        (mechanics.binning == "node", "mechanics.binning: node, which jumps where a node crosses the edge of a bin"),
        (effects.history.any, "mechanics.effects.history, with which a label depends on its path"),
        (placed, f"mechanics.effects.geometry: {', '.join(placed)}, which solved sites around need not feel"),
        (mechanics.store_displacement, "mechanics.store_displacement: displacements are not interpolated"),
        (mechanics.sensitivities, "mechanics.sensitivities: derivatives are not interpolated"),
        (share and not mechanics.error_bars, "error_bars: false, a share of which is asked for: give tolerance_N"),
    ]  # fmt: skip
    if reasons := [words for is_so, words in why_not if is_so]:
        raise ConfigError(
            f"plan.interpolation: labels are not interpolated with {reasons[0]}; use interpolation: none"
        )


def lattice_digest(study: Study, lattice: Lattice) -> str:
    """Return the digest of what decides an interpolated label in addition to the solved sites."""
    interpolation = given(study.plan.interpolation, "plan.interpolation")
    known = interpolation.model_dump(mode="json"), lattice.__dict__
    return digest([*map(dict, known), source_digest("interpolation")])


def lattice_of(study: Study, cells: Mapping[str, PlannedCell]) -> Lattice | None:
    """Return the lattice of the plan's sites between which labels may be interpolated.

    Parameters
    ----------
    study : Study
        Sensor, indenter and symmetry.
    cells : mapping of str to PlannedCell
        Sites of the plan.

    Returns
    -------
    Lattice or None
        None where no site may be interpolated, or solving all costs no more.
    """
    inside = [cell for cell in cells.values() if interpolable(study, cell)]
    if not inside:
        return None
    places = np.array([(cell.x_mm, cell.y_mm) for cell in inside])
    sensor, width = study.sensor, None
    low, high = places.min(axis=0), places.max(axis=0)
    if study.mirrors_cells:
        width = sensor.width_x_mm
        half = np.abs(places - width / 2).max()
        low, high = np.full(2, width / 2 - half), np.full(2, width / 2 + half)
    # Forces change over a length of the layers' height (where a wall stands nearer, levels are added).
    along_x, along_y = (int(np.ceil(span / sensor.height_mm - 1e-9)) for span in high - low)
    depths = sorted({depth for cell in inside for depth in cell.depths_mm})
    same = all(cell.depths_mm == inside[0].depths_mm for cell in inside)
    (x0, y0), (x1, y1) = (map(float, np.round(corner, 6)) for corner in (low, high))
    depths_mm = tuple(depths) if same else _ladder(depths)
    lattice = Lattice((x0, y0), (x1, y1), (along_x, along_y), depths_mm, width)
    orbits = {cell.source or cell.name for cell in inside}
    return lattice if len(lattice.representatives(lattice.level(0))) < len(orbits) else None


def _ladder(depths: list[float]) -> tuple[float, ...]:
    """Return DEPTHS depths from the least to the largest [mm]: even steps of the radius of a ball's contact."""
    steps = np.linspace(np.sqrt(depths[0]), np.sqrt(depths[-1]), DEPTHS) ** 2
    return (depths[0], *(round(float(step), 6) for step in steps[1:-1]), depths[-1])


def interpolable(study: Study, cell: PlannedCell) -> bool:
    """Return whether a site's label may be interpolated: a plain press whose contact stays on the top surface."""
    if cell.follows_a_path:
        return False
    *places, radii = shape_of(study.indenter).footprint(cell.deepest_mm).T
    middle = np.array(places) + np.array([[cell.x_mm], [cell.y_mm]])
    width = np.array([[study.sensor.width_x_mm], [study.sensor.width_y_mm]])
    return bool((middle - radii >= -1e-9).all() and (middle + radii <= width + 1e-9).all())


def solved_site(lattice: Lattice, name: str) -> PlannedCell | None:
    """Return the site to be solved at a place of the lattice.

    Parameters
    ----------
    lattice : Lattice
        As `lattice_of` returns it.
    name : str
        As `name_of` returns it.

    Returns
    -------
    PlannedCell or None
        With position [mm] and depths [mm]; None for a name of no place of the lattice.
    """
    at = index_of(name)
    if at is None or any(k > end for k, end in zip(at, lattice.ends)):
        return None
    x, y = map(float, lattice.place(at))
    return PlannedCell(name, x, y, lattice.depths_mm)
