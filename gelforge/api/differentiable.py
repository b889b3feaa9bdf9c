"""An indentation whose forces come with derivatives along place, depth and effects: what an optimiser or a network needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from gelforge.api import arguments
from gelforge.api.materials import Fitted
from gelforge.api.press import Described, described_study, known_materials
from gelforge.api.printed import components, table
from gelforge.config import ConfigError, Study

if TYPE_CHECKING:
    from gelforge.indentation.solving.sensitivities import Variation
    from gelforge.learning.basis.torch_press import Tensor, TorchForces

PLACE = ("x_mm", "y_mm", "depth_mm")
STEP_MM = 1e-3  # by which derivatives along place and depth are taken
OTHER_PATH = {"frame_compliance", "base_bending", "prestretch"}  # effects that make the path another one


@dataclass(frozen=True)
class PressSlopes:
    """Forces at each step of an indentation, and their derivatives by the name of what they follow.

    D steps; B = nx ny bins of the undeformed top surface, k = nx iy + ix; axes as in `Pressed`.
    """

    depth_mm: np.ndarray  # (D,)
    total_force_N: np.ndarray  # (D, 3)
    bin_force_N: np.ndarray  # (D, B, 3)
    total_slope: dict[str, np.ndarray]  # (D, 3) [N per unit]
    bin_slope: dict[str, np.ndarray]  # (D, B, 3) [N per unit]

    def __repr__(self) -> str:
        shown = {"force [N]": self.total_force_N[-1]}
        for name, slope in self.total_slope.items():
            shown[f"d/d {name} [{'N/mm' if name in PLACE else 'N per unit'}]"] = slope[-1]
        rows = [[name, *components(values, np.abs(values).max())] for name, values in shown.items()]
        return (
            f"PressSlopes: total force on the sensor at {self.depth_mm[-1]:.4g} mm, the last of {len(self.depth_mm)} steps\n"
            f"{table(['', 'Fx', 'Fy', 'Fz'], rows)}\n  forces of {self.bin_force_N.shape[1]} bins in bin_force_N, bin_slope"
        )


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
    materials: Mapping[str, Described | Fitted] | None = None,
    mechanics: Described | None = None,
    study: Study | str | Path | None = None,
) -> PressSlopes:
    """Return the forces of an indentation with their derivatives along its place, its depth and effects.

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

    Returns
    -------
    PressSlopes
        Forces [N] in total (D, 3) and per bin (D, B, 3) at D steps, and their derivatives [N per unit] by name.

    Raises
    ------
    ConfigError
        As `gelforge.press`; and for what has no derivative along an indentation: an effect that is on or off, has a memory,
        brings another mesh or another path, and a place on a sensor that is no block or is meshed by tetrahedra.
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
    from gelforge.indentation.planning.plan import check_inside, press_path
    from gelforge.indentation.solving.sensitivities import derivatives
    from gelforge.laws_of_study import laws_and_doubts

    x_mm, y_mm, depth_mm = (
        arguments.number(*one) for one in (("x_mm", x_mm), ("y_mm", y_mm), ("depth_mm", depth_mm))
    )
    steps = arguments.whole("steps", steps)
    if not depth_mm > 0:
        raise ConfigError(f"depth_mm={depth_mm:g}: a depth above 0 is needed")
    given = {} if effects is None else arguments.mapping("effects", effects, "{'gel_stiffness': 0.1}")
    amounts = {name: arguments.number(f"effects[{name!r}]", amount) for name, amount in given.items()}
    wanted = [*PLACE, *amounts] if along is None else arguments.names("along", along)
    described = described_study(study, sensor, indenter, materials, mechanics, ())
    _check(described, amounts, wanted)
    forces_only = described.mechanics.model_copy(update={"store_displacement": False})
    described = described.model_copy(update={"mechanics": forces_only})
    share = np.arange(1, steps + 1) / steps
    planned = press_path("press", x_mm, y_mm, (depth_mm * share).tolist(), None, False)
    check_inside({planned.name: planned}, described)
    laws = laws_and_doubts(known_materials(described, materials))[0]
    base = _with_amounts(described, amounts)
    variations = {
        name: _effect_varied(described, laws, amounts, name)
        if name in amounts
        else _place_varied(base, laws, (x_mm, y_mm), name, share)
        for name in wanted
    }
    cell, slopes = derivatives(base, laws, planned, variations)
    return PressSlopes(
        depth_mm * share,
        cell.arrays["total_force_N"],
        cell.arrays["bin_force_N"],
        {name: slope.total for name, slope in slopes.items()},
        {name: slope.bins for name, slope in slopes.items()},
    )


def torch_press(
    x_mm: Tensor | float,
    y_mm: Tensor | float,
    depth_mm: Tensor | float,
    effects: Mapping[str, Tensor | float] | None = None,
    **described: Any,
) -> TorchForces:
    """Return the forces of an indentation as tensors whose gradients are the derivatives of the finite elements.

    Gradients flow to those of x_mm, y_mm [mm], depth_mm [mm] and the amounts of `effects` that are tensors with
    requires_grad; only for these derivatives are computed. They are first derivatives: a second one is refused by PyTorch. A
    call solves one indentation, in seconds; several indentations are several calls.

    Parameters
    ----------
    x_mm, y_mm, depth_mm : tensor of one element, or float
        Position from the corner of the sensor's top surface, and depth from the first touch [mm].
    effects : mapping of str to tensor of one element, or float
        Amounts of effects, as in `gelforge.press_slopes`.
    **described
        `steps`, `sensor`, `indenter`, `materials`, `mechanics` and `study`, as in `gelforge.press_slopes`.

    Returns
    -------
    TorchForces
        Forces [N] in total (D, 3) and per bin (D, B, 3) at each step of the indentation; the last is that at depth_mm.

    Raises
    ------
    ConfigError
        As `gelforge.press_slopes`, and for tensors of more than one element.
    NotConverged
        As `gelforge.press_slopes`.

    Examples
    --------
    Which depth gives 0.3 N? Newton's method with the gradient:

    >>> import gelforge as gf, torch
    >>> gel = {"name": "gel", "thickness_mm": 4, "material": "gel"}
    >>> small = dict(
    ...     steps=2,
    ...     sensor={"width_x_mm": 16, "width_y_mm": 16, "wall_mm": 0, "layers": [gel], "bins": {"nx": 8, "ny": 8}},
    ...     materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    ...     indenter={"kind": "sphere", "radius_mm": 4},
    ...     mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 2, "far_mm": 2}},
    ... )
    >>> depth = torch.tensor(0.8, dtype=torch.float64, requires_grad=True)
    >>> for _ in range(3):
    ...     force = -gf.torch_press(8.0, 8.0, depth, **small).total_N[-1, 2]
    ...     (slope,) = torch.autograd.grad(force, depth)
    ...     depth = (depth - (force - 0.3) / slope).detach().requires_grad_()
    >>> bool(abs(-gf.torch_press(8.0, 8.0, depth, **small).total_N[-1, 2] - 0.3) < 1e-3)
    True
    """
    from gelforge.learning.basis.torch_press import forces_as_tensors

    def solved(numbers: dict[str, float], along: list[str]) -> PressSlopes:
        amounts = dict(numbers)
        x, y, depth = (amounts.pop(name) for name in PLACE)
        return press_slopes(x, y, depth, amounts, along=along, **described)

    return forces_as_tensors(solved, {"x_mm": x_mm, "y_mm": y_mm, "depth_mm": depth_mm, **(effects or {})})


def effects_with_slopes() -> list[str]:
    """Return the names of the effects that have a derivative along an indentation.

    Returns
    -------
    list of str
        Keys that `effects` of `press_slopes` takes.

    Examples
    --------
    >>> "friction" in effects_with_slopes()
    True
    """
    from gelforge.indentation.effects.catalogue import CATALOGUE

    return sorted(
        name
        for name, effect in CATALOGUE.items()
        if not (effect.binary or effect.history or effect.mesh_changes or name in OTHER_PATH)
    )


def _check(study: Study, amounts: Mapping[str, float], wanted: Sequence[str]) -> None:
    """Raise ConfigError for what has no derivative along an indentation of a study."""
    if unknown := sorted(amounts.keys() - set(known := effects_with_slopes())):
        raise ConfigError(f"effects: {unknown} have no derivative along an indentation; choose among {known}")
    if unknown := sorted(set(wanted) - {*PLACE, *amounts}):
        raise ConfigError(f"along: {unknown}; choose among {[*PLACE, *amounts]}, effects need a value")
    effects = study.mechanics.effects
    k = effects.kinematics
    if (
        effects.history.any
        or effects.geometry.prestretch
        or k.frame_compliance_mm_per_N
        or k.base_bending_mm_per_N
    ):
        raise ConfigError(
            "mechanics.effects: history, prestretch and compliance of the machine have no derivatives along an indentation;"
            " leave them out, or subtract two results of gelforge.press"
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
    from gelforge.indentation.solving.sensitivities import Variation

    step = CATALOGUE[name].step * CATALOGUE[name].width
    return Variation(_with_amounts(study, {**amounts, name: amounts[name] + step}), laws, step)


def _place_varied(study: Study, laws, place: tuple[float, float], name: str, share: np.ndarray) -> Variation:
    """Return the study pressed close to a place (x, y) [mm], or deeper; share (D,): of the depth, at each step."""
    from gelforge.indentation.effects.catalogue import with_keys
    from gelforge.indentation.effects.kinematics import real_place
    from gelforge.indentation.solving.sensitivities import Variation

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
