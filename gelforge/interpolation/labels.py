"""Sites of an interpolated plan: a label between solved sites, or the solved one that lies at its place."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

import gelforge
from gelforge.config import Study
from gelforge.indentation.cells.binning import without_dust
from gelforge.indentation.cells.cell_file import TIMINGS, Cell
from gelforge.indentation.paths.places import ROUNDING_MM
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.lattice import name_of
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.mirror import mirror_cell
from gelforge.interpolation.solved_sites import OWN, SolvedSites
from gelforge.mechanics.laws.law import PrincipalLaw

BY_DEPTH = (  # of OF_SITE: one value a depth
    "volume_outside_valid_range",
    "volume_law_unstable",
    "stretch_range",
    "leaves_valid_range",
    "law_unstable",
)
# attributes of the nearest solved site that hold for a label between as well: ranges of stretch, what was touched
OF_SITE = (
    "settings",
    "regions",
    "touched_parts",
    "linear_solver",
    "degrees_of_freedom",
    "uncertain_materials",
    *BY_DEPTH,
)
SAME_MM = 2 * ROUNDING_MM  # of two rounded positions


@dataclass(frozen=True)
class Labels:
    """What the labels of a plan are made from."""

    study: Study
    laws: Mapping[str, PrincipalLaw]  # by material
    solved: SolvedSites
    own: Mapping[str, Cell]  # sites of the plan that were solved themselves, by name

    def cell(self, planned: PlannedCell) -> Cell:
        """Return a site's label: solved where a solved site lies, interpolated elsewhere, failed next to a failed one."""
        identity = {
            "cell": planned.name,
            "x_mm": planned.x_mm,
            "y_mm": planned.y_mm,
            "source": "",
            "inputs_digest": inputs_digest(self.study, dict(self.laws), planned),
        }
        at_place = self.own.get(planned.name) or self._solved_there(planned)
        if at_place is not None:
            kept, arrays = (
                {key: value for key, value in part.items() if not key.startswith("sensitivity_")}
                for part in (at_place.attributes, at_place.arrays)
            )
            kept = {key: value for key, value in kept.items() if key not in TIMINGS}
            return Cell(arrays, kept | identity | {"solved_as": at_place.attributes["cell"]})
        position = np.array([planned.x_mm, planned.y_mm])
        if failed := self.solved.failed_near(position):
            reason = f"not interpolated: solved site {failed}, on which it leans, has failed"
            known = {"status": "failed", "reason": reason, "last_good_depth_mm": 0.0}
            return Cell(
                {"depth_mm": np.zeros(0), "total_force_N": np.zeros((0, 3)), "bin_force_N": self._no_bins()},
                identity | known | {"code_version": gelforge.__version__, "interpolated_from": [failed]},
            )
        return self._between(planned, position, identity)

    def _no_bins(self) -> np.ndarray:
        bins = self.study.sensor.bins
        return np.zeros((0, bins.nx * bins.ny, 3))

    def _solved_there(self, planned: PlannedCell) -> Cell | None:
        """Return the solved site at a site's place, or the image that lies there, if it has the same depths."""
        lattice = self.solved.lattice
        if planned.depths_mm != lattice.depths_mm:
            return None
        for at, cell in self.solved.cells.items():
            for image in lattice.images(at):
                if np.abs(lattice.place(image) - [planned.x_mm, planned.y_mm]).max() > SAME_MM:
                    continue
                if image == at or not cell.converged:
                    return cell
                symmetry = lattice.symmetry_to(at, image)
                as_image = replace(planned, source=name_of(at), symmetry=symmetry)
                moved = mirror_cell(cell, self.study, dict(self.laws), as_image)
                return Cell(moved.arrays, moved.attributes | {"cell": name_of(at)})
        return None

    def _between(self, planned: PlannedCell, position: np.ndarray, identity: dict) -> Cell:
        wall_clock, cpu_clock = time.perf_counter(), time.process_time()
        depths = planned.depths_mm
        forces, bars = self.solved.at(position, depths), self.solved.bars_at(position, depths)
        normal, friction = (without_dust(part) for part in np.split(forces.bins, 2, axis=-1))
        bin_force = without_dust(normal + friction)
        arrays = {
            "depth_mm": np.array(depths),
            "shear_mm": np.zeros((len(depths), 2)),
            "tilt_deg": np.zeros((len(depths), 2)),
            "indenter_mm": forces.centre + [*position, 0.0],
            "total_force_N": forces.force.sum(axis=1),
            "reaction_N": forces.reaction,
            "side_force_N": np.zeros((len(depths), 3)),
            "bin_force_N": bin_force,
            "bin_normal_N": normal,
            "bin_shear_N": friction,
        }
        parts = [part for part in OWN if f"bin_{part}" in bars] + ["interpolation"]
        for quantity in ("bin", "total"):
            arrays |= {f"{quantity}_sigma_{part}_N": bars[f"{quantity}_{part}"] for part in parts}
        summed: dict[str, float] = {}
        for name, weight in zip(forces.names, forces.weights):
            summed[name] = summed.get(name, 0.0) + weight
        largest = sorted(summed, key=lambda name: -abs(summed[name]))
        attributes = {
            "status": "converged",
            "reason": "",
            "last_good_depth_mm": float(max(depths)),
            "phases": ["load"] * len(depths),
            "code_version": gelforge.__version__,
            "interpolated_from": largest,
            "interpolation_weights": [summed[name] for name in largest],
            "seconds": time.perf_counter() - wall_clock,
            "cpu_seconds": time.process_time() - cpu_clock,
        }
        return Cell(arrays, self._of_site(largest[0], depths) | attributes | identity)

    def _of_site(self, name: str, depths: tuple[float, ...]) -> dict:
        """Return what is known of the solved site that a label leans on most, by depth that of the next deeper one."""
        known = np.array(self.solved.lattice.depths_mm)
        cell = next(cell for cell in self.solved.cells.values() if cell.attributes["cell"] == name)
        deeper = np.minimum(np.searchsorted(known, np.array(depths) - 1e-9), len(known) - 1)
        return {
            key: np.asarray(cell.attributes[key])[deeper] if key in BY_DEPTH else cell.attributes[key]
            for key in OF_SITE
            if key in cell.attributes
        }
