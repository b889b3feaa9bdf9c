"""A press whose forces come with derivatives along place, depth and effects: what an optimiser or a network needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.described import Described, described_study

if TYPE_CHECKING:
    from gelforge.indentation.sensitivities import Variation

PLACE = ("x_mm", "y_mm", "depth_mm")
STEP_MM = 1e-3  # by which derivatives along place and depth are taken
OTHER_PATH = {"frame_compliance", "base_bending", "prestretch"}  # effects that make the path another one


@dataclass(frozen=True)
class PressSlopes:
    """Forces at each step of a press, and their derivatives by the name of what they follow.

    D steps; B = nx ny bins of the undeformed top surface, k = nx iy + ix; axes as in `Pressed`.
    """

    depth_mm: np.ndarray  # (D,)
    total_force_N: np.ndarray  # (D, 3)
    bin_force_N: np.ndarray  # (D, B, 3)
    total_slope: dict[str, np.ndarray]  # (D, 3) [N per unit]
    bin_slope: dict[str, np.ndarray]  # (D, B, 3) [N per unit]


def press_slopes(
    x_mm: float,
    y_mm: float,
    depth_mm: float,
    effects: Mapping[str, float] | None = None,
    *,
    along: Sequence[str] | None = None,
    steps: int = 4,
    sensor: Described | str | Path | None = None,
    indenter: Described | str | Path | None = None,
    materials: Mapping[str, Described] | None = None,
    mechanics: Described | None = None,
    study: Study | str | Path | None = None,
) -> PressSlopes:
    """Return the forces of a press with their derivatives along its place, its depth and effects.

    One run of the finite elements gives both: derivatives are those of the converged states (direct differentiation, path
    history of friction included), each at the cost of a back-substitution.

    Parameters
    ----------
    x_mm, y_mm : float
        Position [mm] from the corner of the sensor's top surface.
    depth_mm : float
        Depth [mm] from the first touch, reached in `steps` equal steps; with the depth all of them change in proportion.
    effects : mapping of str to float
        Amounts of effects, such as {"gel_stiffness": 0.1} for 10 % stiffer; docs/effects.md gives their units.
    along : sequence of str, optional
        Which derivatives are wanted: "x_mm", "y_mm", "depth_mm" and names of `effects`; all of these if not given.
    steps : int
        Steps of the path; forces are returned at each.
    sensor, indenter, materials, mechanics, study
        As in `gelforge.press`.

    Raises
    ------
    ConfigError
        As `gelforge.press`; and for what has no derivative along a press: an effect that is on or off, has a memory, brings
        another mesh or another path, and a place on a sensor that is no block or is meshed by tetrahedra.
    NotConverged
        The solution of a step was not found: take more steps or a smaller depth.

    Examples
    --------
    >>> import gelforge as gf
    >>> gel = {"name": "gel", "thickness_mm": 4, "material": "gel"}
    >>> found = gf.press_slopes(
    ...     8.0,
    ...     8.0,
    ...     0.8,
    ...     {"friction": 0.0},
    ...     steps=2,
    ...     sensor={"width_x_mm": 16, "width_y_mm": 16, "wall_mm": 0, "layers": [gel], "bins": {"nx": 8, "ny": 8}},
    ...     materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    ...     indenter={"kind": "sphere", "radius_mm": 4},
    ...     mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 2, "far_mm": 2}},
    ... )
    >>> found.total_force_N.shape, sorted(found.bin_slope)
    ((2, 3), ['depth_mm', 'friction', 'x_mm', 'y_mm'])
    >>> bool(found.total_slope["depth_mm"][-1, 2] < 0)  # deeper: pressed down harder
    True
    """
    from gelforge.indentation.plan import check_inside, press_path
    from gelforge.indentation.sensitivities import derivatives
    from gelforge.laws_of_study import laws_and_doubts, material_laws_of

    if steps < 1 or not depth_mm > 0:
        raise ConfigError(
            f"depth_mm {depth_mm:g} in {steps} steps: a positive depth and one step or more are needed"
        )
    amounts = dict(effects or {})
    wanted = [*PLACE, *amounts] if along is None else list(along)
    described = described_study(study, sensor, indenter, materials, mechanics)
    _check(described, amounts, wanted)
    forces_only = described.mechanics.model_copy(update={"store_displacement": False})
    described = described.model_copy(update={"mechanics": forces_only})
    share = np.arange(1, steps + 1) / steps
    planned = press_path("press", x_mm, y_mm, (depth_mm * share).tolist(), None, False)
    check_inside({planned.name: planned}, described)
    laws = laws_and_doubts(material_laws_of(described, []))[0]
    base = _with_amounts(described, amounts)
    variations = {
        name: _effect_varied(described, laws, amounts, name)
        if name in amounts
        else _place_varied(base, laws, (x_mm, y_mm), name, share)
        for name in wanted
    }
    cell, found = derivatives(base, laws, planned, variations)
    return PressSlopes(
        depth_mm * share,
        cell.arrays["total_force_N"],
        cell.arrays["bin_force_N"],
        {name: slope.total for name, slope in found.items()},
        {name: slope.bins for name, slope in found.items()},
    )


def effects_with_slopes() -> list[str]:
    """Return the names of the effects that have a derivative along a press."""
    from gelforge.indentation.effects.catalogue import CATALOGUE

    return sorted(
        name
        for name, effect in CATALOGUE.items()
        if not (effect.switch or effect.history or effect.mesh_changes or name in OTHER_PATH)
    )


def _check(study: Study, amounts: Mapping[str, float], wanted: Sequence[str]) -> None:
    """Raise ConfigError for what has no derivative along a press of a study."""
    if unknown := sorted(amounts.keys() - set(known := effects_with_slopes())):
        raise ConfigError(f"effects: {unknown} have no derivative along a press; choose among {known}")
    if unknown := sorted(set(wanted) - {*PLACE, *amounts}):
        raise ConfigError(f"along: {unknown}; choose among {[*PLACE, *amounts]}, effects need an amount")
    effects = study.mechanics.effects
    k = effects.kinematics
    if (
        effects.history.any
        or effects.geometry.prestretch
        or k.frame_compliance_mm_per_N
        or k.base_bending_mm_per_N
    ):
        raise ConfigError(
            "mechanics.effects: no derivatives along a press of a gel with a memory or a residual stretch, or with a machine"
            " that yields; leave these out, or subtract two answers of gelforge.press"
        )
    block = study.sensor.shape.kind == "block" and study.mechanics.mesh.elements != "tetrahedra"
    if not block and {"x_mm", "y_mm"} & set(wanted):
        raise ConfigError(
            "along: x_mm and y_mm have derivatives on a block meshed by hexahedra only; ask for the others, or subtract two"
            " answers of gelforge.press"
        )


def _with_amounts(study: Study, amounts: Mapping[str, float]) -> Study:
    """Return a study with amounts of effects."""
    from gelforge.indentation.effects.catalogue import CATALOGUE

    for name, amount in amounts.items():
        study = CATALOGUE[name](study, float(amount)) if amount else study
    return study


def _effect_varied(study: Study, laws, amounts: Mapping[str, float], name: str) -> Variation:
    """Return the study with amounts of effects and a little more of one of them."""
    from gelforge.indentation.effects.catalogue import CATALOGUE
    from gelforge.indentation.sensitivities import Variation

    step = CATALOGUE[name].step * CATALOGUE[name].width
    return Variation(_with_amounts(study, {**amounts, name: amounts[name] + step}), laws, step)


def _place_varied(study: Study, laws, place: tuple[float, float], name: str, share: np.ndarray) -> Variation:
    """Return the study pressed a little beside a place (x, y) [mm], or deeper; share (D,): of the depth, at each step."""
    from gelforge.indentation.effects.catalogue import with_keys
    from gelforge.indentation.effects.kinematics import real_place
    from gelforge.indentation.sensitivities import Variation

    effects = study.mechanics.effects
    if name == "depth_mm":
        deeper = effects.kinematics.contact_zero_mm + STEP_MM
        return Variation(
            with_keys(study, kinematics={"contact_zero_mm": deeper}), laws, STEP_MM, share=tuple(share)
        )
    sent = np.array(place) + STEP_MM * np.array([name == "x_mm", name == "y_mm"])
    moved = np.array(real_place(study.sensor, effects, *sent)) - real_place(study.sensor, effects, *place)
    shift = (np.array(effects.kinematics.misregistration_mm) + moved).tolist()
    return Variation(with_keys(study, kinematics={"misregistration_mm": shift}), laws, STEP_MM)
