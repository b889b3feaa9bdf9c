"""An indentation whose answer is forces with error bars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gelforge.api import arguments
from gelforge.api.materials import Fitted
from gelforge.api.printed import components, table, with_error
from gelforge.api.studies import indenters, paper_study, sensors, shipped_like, study_of
from gelforge.config import ConfigError, Study, study_from
from gelforge.config.basis.variants import merged
from gelforge.section import Section

if TYPE_CHECKING:
    from gelforge.indentation.cells.cell_file import Cell

Described = Section | Mapping[str, Any]  # a block of a study: its keys, or the section that they make


@dataclass(frozen=True)
class Slopes:
    """How forces follow the value of one effect: derivatives [`unit`]."""

    unit: str
    total: np.ndarray  # (D, 3)
    bins: np.ndarray  # (D, B, 3)

    def __repr__(self) -> str:
        last = ", ".join(components(self.total[-1], np.abs(self.total[-1]).max()))
        return f"Slopes: total ({last}) {self.unit} at the last step; total {self.total.shape}, bins {self.bins.shape}"


@dataclass(frozen=True)
class Pressed:
    """Forces on the sensor, depth by depth.

    D depths; B = nx ny bins of the undeformed top surface, k = nx iy + ix; S nodes of the top surface. Vectors have the axes
    x, y, z of the sensor's frame: origin at a corner of the top surface, z up, so that an indentation has negative Fz.
    Standard deviations are those of discretisation and, of fitted materials, of the constitutive model, added in squares;
    of single nodes none is known. The bins and `side_force_N` add up to the total.
    """

    phase: tuple[str, ...]  # D: "load", "shear", "twist", "unload"
    depth_mm: np.ndarray  # (D,) [mm]
    total_force_N: np.ndarray  # (D, 3) [N]
    total_sigma_N: np.ndarray | None  # (D, 3) [N]; None with mechanics.error_bars false
    side_force_N: np.ndarray  # (D, 3) [N] on side faces, in no bin
    bin_force_N: np.ndarray  # (D, B, 3) [N], normal and friction together
    bin_normal_N: np.ndarray  # (D, B, 3) [N], along the contact normal
    bin_friction_N: np.ndarray  # (D, B, 3) [N]
    bin_sigma_N: np.ndarray | None  # (D, B, 3) [N] of bin_force_N
    node_xy_mm: np.ndarray  # (S, 2) [mm], undeformed
    node_displacement_mm: np.ndarray  # (D, S, 3) [mm]
    node_normal_N: np.ndarray  # (D, S, 3) [N]
    node_friction_N: np.ndarray  # (D, S, 3) [N]
    node_state: np.ndarray  # (D, S) [1]: 0 open, 1 stick, 2 slip
    slopes: dict[str, Slopes]  # by effect, of those that were asked for
    cell: Cell  # everything else that is known; gelforge.indentation.cells.cell_file.write_cell writes it

    def __repr__(self) -> str:
        largest = float(np.abs(self.total_force_N).max(initial=0.0))
        forces = [components(force, largest) for force in self.total_force_N]
        if self.total_sigma_N is not None:
            pairs = zip(self.total_force_N, self.total_sigma_N)
            forces = [list(map(with_error, force, sigma)) for force, sigma in pairs]
        rows = [
            [f"{depth:.4g}", phase, *force] for depth, phase, force in zip(self.depth_mm, self.phase, forces)
        ]
        head = ["depth_mm", "phase", *(f"F{axis} [N]" for axis in "xyz")]
        error = "" if self.total_sigma_N is None else " +- standard deviation"
        slopes = f"; slopes along {', '.join(self.slopes)}" if self.slopes else ""
        return (
            f"Pressed: total force on the sensor{error}\n{table(head, rows)}\n"
            f"  {self.bin_force_N.shape[1]} bins (bin_force_N, ...), {len(self.node_xy_mm)} nodes (node_normal_N, ...)"
            f"{slopes}"
        )

    @classmethod
    def of(cls, cell: Cell) -> Pressed:
        """Return the forces of a solved site.

        Parameters
        ----------
        cell : Cell
            As `gelforge.press` solves it.

        Returns
        -------
        Pressed
            Forces [N] at each depth that was reached.
        """
        a, attributes = cell.arrays, cell.attributes
        slopes = {
            str(name): Slopes(str(unit), a["sensitivity_total"][k], a["sensitivity_bin"][k])
            for k, (name, unit) in enumerate(
                zip(attributes.get("sensitivity_names", ()), attributes.get("sensitivity_units", ()))
            )
        }
        same = ["depth_mm", "total_force_N", "side_force_N", "bin_force_N", "bin_normal_N", "node_xy_mm"]
        same += ["node_displacement_mm", "node_normal_N", "node_state"]
        return cls(
            phase=tuple(str(phase) for phase in attributes["phases"]),
            total_sigma_N=_sigma(a, "total"),
            bin_friction_N=a["bin_shear_N"],
            bin_sigma_N=_sigma(a, "bin"),
            node_friction_N=a["node_shear_N"],
            slopes=slopes,
            cell=cell,
            **{name: a[name] for name in same},
        )


def _sigma(arrays: Mapping[str, np.ndarray], of: str) -> np.ndarray | None:
    """Return the standard deviation from all known sources; None where none was asked for."""
    if f"{of}_sigma_mesh_N" not in arrays:
        return None
    return np.hypot(arrays[f"{of}_sigma_mesh_N"], arrays[f"{of}_sigma_material_N"])


def press(
    x_mm: float,
    y_mm: float,
    depths_mm: float | Sequence[float],
    *,
    sensor: Described | str | Path | None = None,
    indenter: Described | str | Path | None = None,
    materials: Mapping[str, Described | Fitted] | None = None,
    mechanics: Described | None = None,
    study: Study | str | Path | None = None,
    shear_mm: tuple[float, float] | None = None,
    twist_deg: float = 0.0,
    unload: bool = False,
    sensitivities: Sequence[str] = (),
) -> Pressed:
    """Return the contact forces on a soft sensor that a rigid indenter presses, by finite elements.

    Parameters
    ----------
    x_mm, y_mm : float
        Position [mm] from the corner of the sensor's top surface.
    depths_mm : float or sequence of float
        Increasing depths [mm] from the first touch; one load path runs through all of them.
    sensor, indenter, materials, mechanics : mapping, section, or path of a YAML file
        Blocks with the keys of a study's configuration (config/schema.json). Each replaces the study's own but `mechanics`,
        whose keys change the study's. A material may be what `gelforge.fit` returned; its uncertainty is in the error bars.
    study : Study or path, optional
        What the blocks are not given for; the article's sensor (config/paper.yaml) if there is none.
    shear_mm : (float, float), optional
        Then move sideways by this [mm] at the last depth, in steps of 0.1 mm or less.
    twist_deg : float
        Then turn the indenter about z [deg], in steps of 1 deg or less.
    unload : bool
        Then take it away again by the same depths.
    sensitivities : sequence of str
        Effects (docs/effects.md) whose derivatives are wanted in `slopes`.

    Returns
    -------
    Pressed
        Forces [N] in total (D, 3), per bin (D, B, 3) and per surface node (D, S, 3), normal and friction apart, with
        standard deviations of totals and bins.

    Raises
    ------
    ConfigError
        A key, value or position that cannot be pressed, or a material without a constitutive model.
    CellError
        The solution of a depth was not found; the message names the last good one.

    Examples
    --------
    A ball on a block of soft silicone, on a mesh that is coarse to be quick:

    >>> import gelforge as gf
    >>> gel = {"name": "gel", "thickness_mm": 4, "material": "gel"}
    >>> answer = gf.press(
    ...     8.0,
    ...     8.0,
    ...     [0.4, 0.8],
    ...     sensor={"width_x_mm": 16, "width_y_mm": 16, "wall_mm": 0, "layers": [gel], "bins": {"nx": 8, "ny": 8}},
    ...     materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    ...     indenter={"kind": "sphere", "radius_mm": 4},
    ...     mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 2, "far_mm": 2}},
    ... )
    >>> answer.total_force_N.shape, answer.bin_force_N.shape
    ((2, 3), (2, 64, 3))
    >>> bool(answer.total_force_N[1, 2] < answer.total_force_N[0, 2] < 0)  # pressed down, harder when deeper
    True
    >>> nodes = (answer.node_normal_N + answer.node_friction_N).sum(axis=1)
    >>> bool(np.allclose(nodes, answer.bin_force_N.sum(axis=1), atol=1e-9))  # one force, by nodes and by bins
    True
    >>> bool((answer.bin_sigma_N > 0).any())
    True
    """
    from gelforge.indentation.cells.cell_file import CellError
    from gelforge.indentation.planning.plan import check_inside, press_path
    from gelforge.indentation.solving.companion import simulate_label
    from gelforge.laws_of_study import laws_and_doubts

    x_mm, y_mm = arguments.number("x_mm", x_mm), arguments.number("y_mm", y_mm)
    depths = arguments.numbers("depths_mm", depths_mm)
    shear = None if shear_mm is None else arguments.numbers("shear_mm", shear_mm, 2)
    twist = arguments.number("twist_deg", twist_deg)
    if depths[0] <= 0 or any(b <= a for a, b in zip(depths, depths[1:])):
        raise ConfigError(f"depths_mm {depths}: one or more depths that are positive and increase are needed")
    described = described_study(study, sensor, indenter, materials, mechanics, sensitivities)
    planned = press_path("press", x_mm, y_mm, depths, shear, unload, twist)
    check_inside({planned.name: planned}, described)
    cell = simulate_label(described, *laws_and_doubts(known_materials(described, materials)), planned)
    if not cell.converged:
        raise CellError(
            f"the indentation failed: {cell.attributes['reason']}; last good depth"
            f" {cell.attributes['last_good_depth_mm']:g} mm"
        )
    return Pressed.of(cell)


def known_materials(study: Study, materials: Mapping[str, Described | Fitted] | None) -> dict:
    """Return the models of a study's materials by name, with the uncertainty of those that were given as fits."""
    from gelforge.laws_of_study import material_laws_of

    fitted = {name: one.law for name, one in (materials or {}).items() if isinstance(one, Fitted)}
    return material_laws_of(study, []) | fitted


def described_study(study, sensor, indenter, materials, mechanics, sensitivities) -> Study:
    """Return a study whose blocks are those that are given, validated as a whole."""
    base = paper_study() if study is None else study_of(study)
    given = {"sensor": sensor, "indenter": indenter}
    given = {key: _block(key, block) for key, block in given.items() if block is not None}
    if materials is not None:
        example = "{'gel': gelforge.fit(folder)}"
        by_name = arguments.mapping("materials", materials, example)
        given["materials"] = {name: _material(name, material) for name, material in by_name.items()}
    content = base.model_dump(mode="json", exclude={"variants", "synthesis"})
    changes = {} if mechanics is None else dict(_plain("mechanics", mechanics, "{'friction': 0.5}"))
    if sensitivities:
        changes["sensitivities"] = arguments.names("sensitivities", sensitivities)
    content["mechanics"] = merged(content["mechanics"], changes)
    return study_from(content | given, "gelforge.press")


def _block(key: str, block: Any) -> dict[str, Any] | str:
    """Return the keys of a sensor or an indenter, or the path of its YAML file as text."""
    if isinstance(block, Study):
        raise ConfigError(f"{key}: a whole study; pass study=..., or its block: {key}=study.{key}")
    if not isinstance(block, str | Path):
        return _plain(key, block, "study.sensor" if key == "sensor" else "{'kind': 'sphere', 'radius_mm': 4}")
    if Path(block).is_file():
        return str(block)
    what = "a folder" if Path(block).is_dir() else "no such file"
    if key == "indenter":
        remedy = f"pass keys such as {{'kind': 'sphere', 'radius_mm': 4}} (kinds: {', '.join(indenters())})"
    else:
        near = shipped_like(block)
        remedy = f"for a shipped sensor pass study=gelforge.sensor({near or 'name'!r}) (there are {', '.join(sensors())})"
    raise ConfigError(f"{key}={str(block)!r}: {what}; {remedy}, or the path of a YAML file")


def _material(name: str, material: Any) -> dict[str, Any]:
    """Return the keys of a material."""
    if isinstance(material, Fitted):
        return material.block
    return _plain(f"materials[{name!r}]", material, "{'parameters': {'law': 'neo_hooke', 'mu_kPa': 20}}")


def _plain(name: str, block: Any, example: str) -> dict[str, Any]:
    """Return a block's keys; example: a block that could be passed."""
    if isinstance(block, Section):
        return block.model_dump(mode="json")
    return dict(arguments.mapping(name, block, example))
