"""The solved sites and their mirror images: forces between them, and how far these may be wrong.

Error bars of an interpolated force have the parts of solved ones, moved with the indenter, and one of their own: each
solved site is predicted without itself, and without its lines of the lattice, and the mean squares of what its forces then
differ by are carried to the places around. A site that is left out lies a whole spacing from the others, a place between at
most half of one: the parts below were found by benchmarks/interpolation.py on some positions, and are judged on others.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import gaussian_filter

from gelforge.config import Indenter, Sensor
from gelforge.indentation.cells.cell_file import Cell
from gelforge.indentation.planning.lattice import LAST, Index, Lattice, name_of
from gelforge.indentation.sensor.symmetry import transform_bins, transform_vectors
from gelforge.indentation.solving.error_bars import SMOOTHING
from gelforge.interpolation.nodal_forces import NodalForces, ball_of, contact_width, moved_map
from gelforge.interpolation.weights import depth_weights, nearest, place_weights, positive_weights
from gelforge.mechanics.indenters.shapes import Sphere

# Found on some positions and judged on others by `python benchmarks/interpolation.py`:
# Of the difference of a site that is left out alone (benchmarks/interpolation.py).
SITE_PART = 1.0
# of that of a site that is left out with its line
LINE_PART: Mapping[str, float | np.ndarray] = {"bin": 0.35, "total": np.array([0.6, 0.6, 0.4])}
# Instead of LINE_PART in the outermost cells of the lattice, which sites enclose on one side only; x, y, z of totals. A
# spacing of half the height and more is no small one next to a wall: the next half changes more than an order says.
END_PART: Mapping[str, float | np.ndarray] = {"bin": 0.7, "total": np.array([1.2, 1.2, 1.7])}
# From which spacings are small (benchmarks/interpolation.py).
FINE_LEVEL = 2
# In place of END_PART from FINE_LEVEL on (benchmarks/interpolation.py).
FINE_END_PART: Mapping[str, float | np.ndarray] = {"bin": 0.6, "total": 0.8}
# Of the mesh's bar of bins: between sites on meshes laid out for each place lies their scatter, however near they are
# (benchmarks/interpolation.py).
MESH_PART = 0.25
# Of the difference of a depth that is left out, between two depths (benchmarks/interpolation.py).
DEPTH_PART = 0.4
ORDER = 2  # of the error in the distance of the sites around, where they are sparser than around the site left out
RELIES = 0.05  # weight from which a label is said to lean on a site
OWN = ("mesh", "material")  # parts of a solved label's error bar


@dataclass(frozen=True)
class Site:
    """A solved site, or an image of one, with all its depths; without forces where it failed."""

    name: str  # of the site that was solved
    place: np.ndarray  # (2,) [mm]
    forces: NodalForces | None
    reaction: np.ndarray  # (D, 3) [N]
    centre: np.ndarray  # (D, 3) the indenter's, from the place [mm]
    bars: Mapping[str, np.ndarray]  # bin_mesh (D, ny, nx, 3), total_mesh (D, 3) and so on [N]


@dataclass(frozen=True)
class Between:
    """Forces at a place between solved sites."""

    names: tuple[str, ...]  # of the sites they come from, images under the name of what was solved
    weights: tuple[float, ...]
    bins: np.ndarray  # (D, B, 6) normal and friction forces [N]
    reaction: np.ndarray  # (D, 3)
    centre: np.ndarray  # (D, 3) the indenter's, from the place

    @property
    def force(self) -> np.ndarray:
        """Return the force (D, B, 3) per bin [N]."""
        return self.bins[..., :3] + self.bins[..., 3:]


@dataclass(frozen=True)
class SolvedSites:
    """What is solved of a lattice."""

    lattice: Lattice
    sensor: Sensor
    indenter: Indenter
    cells: Mapping[Index, Cell]  # by representative
    between_depths: bool = False  # labels have other depths than the solved sites

    @cached_property
    def sites(self) -> dict[Index, Site]:
        """Every site with its images, by place."""
        return {
            image: self._site(at, image, cell)
            for at, cell in self.cells.items()
            for image in self.lattice.images(at)
        }

    @cached_property
    def squares(self) -> dict[Index, dict[str, np.ndarray]]:
        """Mean squares [N^2] of what each site's forces differ by when left out: bin, total, bin_depth, total_depth.

        Those of bins are (D, ny, nx, 3), those of totals (D, 3).
        """
        by_site = {}
        for at, cell in self.cells.items():
            left_out = self._left_out(at) if cell.converged else {}
            roots = {key: np.sqrt(value) for key, value in left_out.items()}
            for image in self.lattice.images(at):
                symmetry = self.lattice.symmetry_to(at, image)
                by_site[image] = {key: self._map(symmetry, root) ** 2 for key, root in roots.items()}
        return by_site

    @cached_property
    def _places(self) -> np.ndarray:
        return np.array([site.place for site in self.sites.values()])

    def _site(self, at: Index, image: Index, cell: Cell) -> Site:
        place, name = self.lattice.place(image), name_of(at)
        if not cell.converged:
            return Site(name, place, None, np.zeros((0, 3)), np.zeros((0, 3)), {})
        symmetry, arrays = self.lattice.symmetry_to(at, image), cell.arrays
        known = {
            f"{quantity}_{part}": arrays[f"{quantity}_sigma_{part}_N"]
            for part in OWN
            for quantity in ("bin", "total")
            if f"{quantity}_sigma_{part}_N" in arrays
        }
        centre = arrays["indenter_mm"] - [*self.lattice.place(at), 0.0]
        return Site(
            name,
            place,
            NodalForces.of(cell).mirrored(symmetry),
            transform_vectors(symmetry, arrays["reaction_N"]),
            transform_vectors(symmetry, centre),
            {key: self._map(symmetry, value) for key, value in known.items()},
        )

    def _map(self, symmetry: str, sizes: np.ndarray) -> np.ndarray:
        """Return sizes of bins (D, B, 3) as (D, ny, nx, 3), or of totals (D, 3), carried by a symmetry."""
        bins = self.sensor.bins
        if sizes.ndim == 2:
            return np.abs(transform_vectors(symmetry, sizes))
        moved = sizes if symmetry == "identity" else np.abs(transform_bins(symmetry, sizes, bins.nx))
        return moved.reshape(len(sizes), bins.ny, bins.nx, 3)

    # ---------------------------------------------------------------------------------------------- forces
    def failed_near(self, position: np.ndarray) -> str:
        """Return the name of a failed site that a label at a position (2,) leans on, "" if there is none."""
        sites = list(self.sites.values())
        chosen = nearest(self._places, position)
        weights = place_weights(self._places[chosen], position)
        leans = [sites[k].name for k, w in zip(chosen, weights) if not sites[k].forces and abs(w) > RELIES]
        return leans[0] if leans else ""

    def at(self, position: np.ndarray, depths: Sequence[float], without: Collection[Index] = ()) -> Between:
        """Return the forces at a position (2,) [mm] and depths [mm]; without: as if these places were not solved.

        Raises ValueError for a place outside the solved ones, or a depth beyond theirs: nothing is extrapolated.
        """
        low, high = np.array(self.lattice.low), np.array(self.lattice.high)
        if (position < low - 1e-6).any() or (position > high + 1e-6).any():
            raise ValueError(
                f"({position[0]:g}, {position[1]:g}) mm lies outside the solved {low.tolist()} to {high.tolist()} mm"
            )
        usable = [site for place, site in self.sites.items() if site.forces and place not in without]
        places = np.array([site.place for site in usable])
        chosen = nearest(places, position)
        weights = place_weights(places[chosen], position)
        near = [usable[k] for k in chosen]
        along = [depth_weights(np.array(self.lattice.depths_mm), depth) for depth in depths]
        solved_depths = all(len(numbers) == 1 for numbers, _ in along)
        complete = solved_depths and len(depths) == len(self.lattice.depths_mm)

        def mixed(values: np.ndarray) -> np.ndarray:  # (D, ...) of a site -> at the depths asked for
            return np.stack([np.tensordot(w, values[numbers], 1) for numbers, w in along])

        bins = np.zeros((len(depths), self.sensor.bins.ny, self.sensor.bins.nx, 6))
        for site, weight in zip(near, weights):
            # A sheet that tilts or a yawed machine does not press where it is commanded: by how much is linear in the place.
            if complete:
                bins += weight * site.forces.binned(position, self.sensor)
            else:
                bins += weight * self._over_depths(site.forces, position, depths, along)
        reaction = sum(w * mixed(site.reaction) for site, w in zip(near, weights))
        centre = sum(w * mixed(site.centre) for site, w in zip(near, weights))
        names = tuple(site.name for site in near)
        return Between(names, tuple(map(float, weights)), bins.reshape(len(depths), -1, 6), reaction, centre)

    def _over_depths(self, forces: NodalForces, position: np.ndarray, depths, along) -> np.ndarray:
        """Return bins (d, ny, nx, 6) between depths: each depth's nodes lie as far apart as the contact is then wide."""

        def at_depth(depth: float, number: int) -> np.ndarray:
            known = self.lattice.depths_mm[number]
            wider = contact_width(self._ball, depth) / contact_width(self._ball, known)
            return forces.binned(position, self.sensor, [number], wider)[0]

        mixed = [
            sum(weight * at_depth(depth, number) for number, weight in zip(numbers, weights))
            for depth, (numbers, weights) in zip(depths, along)
        ]
        return np.array(mixed)

    @cached_property
    def _ball(self) -> Sphere | None:
        return ball_of(self.indenter)

    # ------------------------------------------------------------------------------------------ error bars
    def _left_out(self, at: Index) -> dict[str, np.ndarray]:
        """Return mean squares (D, B, 3) and (D, 3) [N^2] of what a solved site's forces differ by if it is left out.

        bin and total: left out alone; bin_line and total_line: with its lines along x and y, both added. Left out alone it
        is predicted well by its neighbours on a line where forces change across the line only. What nothing encloses then is
        not predicted.
        """
        cell, depths = self.cells[at], self.lattice.depths_mm
        left_out = {"": [{at}] if not self.lattice.corner(at) else []}
        left_out["_line"] = [
            {place for place in self.sites if place[axis] == at[axis]}
            for axis in (0, 1)
            if 0 < at[axis] < self.lattice.ends[axis]
        ]
        by_array: dict[str, np.ndarray] = {}
        for kind, all_of in left_out.items():
            for without in all_of:
                squares = self._squares(cell, self.at(self.lattice.place(at), depths, without).force)
                for quantity, square in zip(("bin", "total"), squares):
                    by_array[quantity + kind] = by_array.get(quantity + kind, 0.0) + square
        if self.between_depths:
            by_array["bin_depth"], by_array["total_depth"] = self._squares(cell, self._without_depths(at))
        return by_array

    def _without_depths(self, at: Index) -> np.ndarray:
        """Return the forces (D, B, 3) of a site, each depth interpolated from the others; the ends stand as they are."""
        cell, depths = self.cells[at], np.array(self.lattice.depths_mm)
        forces, place = NodalForces.of(cell), self.lattice.place(at)
        predicted = cell.arrays["bin_force_N"].copy()
        for k in range(1, len(depths) - 1):
            others = np.delete(np.arange(len(depths)), k)
            numbers, weights = depth_weights(depths[others], depths[k])
            along = [([int(others[n]) for n in numbers], weights)]
            bins = self._over_depths(forces, place, depths[k : k + 1], along)[0]
            predicted[k] = (bins[..., :3] + bins[..., 3:]).reshape(-1, 3)
        return predicted

    def _squares(self, cell: Cell, predicted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        bins = self.sensor.bins
        difference = predicted - cell.arrays["bin_force_N"]
        square = (difference**2).reshape(-1, bins.ny, bins.nx, 3)
        borders = ("nearest", "constant", "constant", "nearest")
        mean = gaussian_filter(square, (SMOOTHING, SMOOTHING, SMOOTHING, 0), mode=borders)
        total = difference.sum(axis=1) ** 2
        # on an axis of symmetry one of them is zero by itself
        total[:, :2] = total[:, :2].mean(axis=1, keepdims=True)
        total = gaussian_filter(total, (SMOOTHING, 0), mode="nearest")
        return np.maximum(mean, 0.0).reshape(difference.shape), total

    def _gap(self, position: np.ndarray) -> float:
        """Return how far the sites around a position lie from it: the mean of the four nearest but itself [mm]."""
        away = np.sort(np.linalg.norm(self._places - position, axis=1))
        return float(away[away > 1e-3][:4].mean())

    def _line_part(self, position: np.ndarray) -> Mapping[str, float | np.ndarray]:
        """Return the part of a line's difference at a position (2,): another one in the outermost cells of the lattice.

        There it is nearer to the region's end than the sites around it are to each other.
        """
        number = 0
        while number < LAST and all(at in self.sites for at in self.lattice.around(position, number)):
            number += 1
        ends = np.minimum(position - self.lattice.low, np.array(self.lattice.high) - position)
        open_ends = ends[np.array(self.lattice.ends) > 0]
        if not (open_ends < self.lattice.spacing_mm / 2**number).any():
            return LINE_PART
        return END_PART if number < FINE_LEVEL else FINE_END_PART

    def bars_at(self, position: np.ndarray, depths: Sequence[float]) -> dict[str, np.ndarray]:
        """Return error bars at a position (2,) and depths: bin_mesh (D, B, 3), total_mesh (D, 3) and so on [N].

        interpolation is what the other parts do not hold: how far a label may lie from the one that would be solved there.
        """
        known = np.array(self.lattice.depths_mm)
        # Error bars have no rim: between two depths they grow linearly.
        above = np.clip(np.searchsorted(known, depths), 1, max(len(known) - 1, 1)) if len(known) > 1 else None
        share = np.zeros(len(depths))
        if above is not None:
            share = (depths - known[above - 1]) / np.diff(known)[above - 1]
        by_array: dict[str, np.ndarray] = {}

        def mixed(values: np.ndarray) -> np.ndarray:
            if above is None:
                return np.repeat(values, len(depths), axis=0)
            part = share.reshape(-1, *[1] * (values.ndim - 1))
            return (1 - part) * values[above - 1] + part * values[above]

        def carried(key: str, by_place: Mapping[Index, Mapping[str, np.ndarray]]) -> np.ndarray | None:
            known_at = [at for at, values in by_place.items() if key in values]
            if not known_at:
                return None
            places = np.array([self.sites[at].place for at in known_at])
            chosen = nearest(places, position)[:8]
            total = np.zeros(())
            for number, weight in zip(chosen, positive_weights(places[chosen], position)):
                values = mixed(by_place[known_at[number]][key])
                if by_place is self.squares:
                    values = values * max(1.0, here / self._gap(places[number])) ** (2 * ORDER)
                moved = values.ndim == 4
                by = position - places[number]
                total = total + weight * (moved_map(values, by, self.sensor) if moved else values)
            return total.reshape(len(depths), -1, 3) if total.ndim == 4 else total

        here = self._gap(position)
        bars = {at: site.bars for at, site in self.sites.items()}
        line_part = self._line_part(position)
        for quantity in ("bin", "total"):
            for origin in OWN:
                if (bar := carried(f"{quantity}_{origin}", bars)) is not None:
                    by_array[f"{quantity}_{origin}"] = bar
            square = np.zeros(())
            for kind, part in (("", SITE_PART), ("_line", line_part[quantity])):
                if (left_out := carried(quantity + kind, self.squares)) is not None:
                    square = square + np.square(part) * left_out
            if (over_depth := carried(f"{quantity}_depth", self.squares)) is not None:
                between = 4 * share * (1 - share)  # none at a depth
                between = between.reshape(-1, *[1] * (over_depth.ndim - 1))
                square = square + (DEPTH_PART * between) ** 2 * over_depth
            if quantity == "bin" and "bin_mesh" in by_array:
                square = square + (MESH_PART * by_array["bin_mesh"]) ** 2
            by_array[f"{quantity}_interpolation"] = np.sqrt(square)
        return by_array
