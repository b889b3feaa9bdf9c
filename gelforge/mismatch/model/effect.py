"""What one kind of left-out physics is: its parameters and priors, where it enters, how it is distinguished from others."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gelforge.config import Camera, Study
from gelforge.mismatch.model.context import Context

FAMILIES = (
    "material",
    "history",
    "contact",
    "geometry",
    "kinematics",
    "force sensor",
    "camera",
    "analyst",
    "simplification",
)
ON_BOUND = (
    2e-3  # of a bound, nearer to which a value is on it: fits keep half of that from it (variables.INSIDE)
)
Shape = Mapping[str, float | str]  # what is scanned: a place (refits move it between those), a time constant


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect; 0 is its absence."""

    name: str
    unit: str
    width: float  # standard deviation of its prior: a plausible value
    bounds: tuple[float, float]  # the physical range
    source: str  # of width and bounds
    sign: int = 0  # 1, -1: the only physical sign; 0: both
    whole: bool = False  # its bounds, but for none, are all that there can be, as an empty ball is: physical

    def holds(self, a: float) -> bool:
        """Return whether a value lies inside the bounds and off them, or is all that there can be."""
        low, high = (bound * (1 - ON_BOUND) if np.isfinite(bound) else bound for bound in self.bounds)
        return low < a < high or (self.whole and a != 0 and a in self.bounds)


def one_shape(context: Context) -> list[Shape]:
    """Return the only shape of an effect that has nothing to scan."""
    return [{}]


def where_it_differs(column: str) -> Callable[[Context], list[Shape]]:
    """Return the shapes of an effect that only a circumstance which differs between readings can show: one, or none.

    At one age, or one temperature, it is another name for a stiffer gel.
    """

    def shapes(context: Context) -> list[Shape]:
        table = context.observations.table
        return [{}] if table.empty or table[column].nunique() > 1 else []

    return shapes


def unturned(turn: np.ndarray) -> np.ndarray:
    """Return the turn of a value that is the same from all sides of a square."""
    return np.eye(1)


@dataclass(frozen=True)
class Effect:
    """One kind of left-out physics. Values (P,) are in the parameters' units; all zero is the base bit for bit.

    to_study puts it into the finite elements. to_forces gives the forces (R, 3) on the sensor as read with the effect, from
    those without: exact for the force sensor and the clock, a first approximation for what is solved. to_places gives where
    (R, 2) [mm] each indentation really lands, which images see too. to_camera changes the camera that looks at the
    particles.
    """

    name: str
    family: str
    parameters: tuple[Parameter, ...]
    enters: str  # the keys of the configuration, or the stage
    signature: str  # what it does to readings, in words
    confused_with: tuple[str, ...]
    separated_by: str  # the experiment that distinguishes it from these
    depends_on: tuple[str, ...] = ()  # the effects whose derivatives it is made of
    to_study: Callable[[Study, Shape, Sequence[float]], Study] | None = None
    to_places: Callable[[Context, Shape, Sequence[float]], np.ndarray] | None = None
    to_forces: Callable[[Context, Shape, np.ndarray, Sequence[float]], np.ndarray] | None = None
    to_camera: Callable[[Study, Camera, Sequence[float]], Camera] | None = None
    shapes: Callable[[Context], list[Shape]] = one_shape
    turned: Callable[[np.ndarray], np.ndarray] = (
        unturned  # (2, 2) of D4 -> (P, P): how values turn with the sensor
    )
    applies: Callable[[Study], bool] = field(default=lambda study: True)  # the sensor has what it is about
    binary: bool = False  # values are 0 and 1 only
    history: bool = False  # every indentation is a path of its own, in time
    path_dependent: bool = (
        False  # an indentation leaves something to those after it: all are solved, one after the other
    )
    mesh_changes: bool = False  # its derivative is a difference of two solutions on its own mesh
    step: float = 1e-2  # of a plausible value, at which its derivative is taken
    across: Callable[[Study], float] | None = (
        None  # the value, to either side, across which a difference is taken where there is no other derivative
    )
    unloading: bool = False  # seen during unloading only
    # The coarser mesh does not resolve it, and its formula says more: adhesion's rim is narrower than an element.
    by_formula: bool = False

    @property
    def solved(self) -> bool:
        """Return whether the finite elements are solved with it."""
        return self.to_study is not None and not self.by_formula

    @property
    def data_entry_error(self) -> bool:
        """Return whether it is a mistake of the analyst, which is excluded before physics is blamed, and no physics."""
        return self.family == "analyst"

    @property
    def prior_sd(self) -> np.ndarray:
        """Return the plausible values (P,)."""
        return np.array([parameter.width for parameter in self.parameters])

    def in_range(self, amounts: Sequence[float] | np.ndarray) -> bool:
        """Return whether every value has its physical sign and lies inside its bounds, and on none that is not whole.

        Of several values of one sign some may be absent.
        """
        absent = [p.sign != 0 and a == 0 for p, a in zip(self.parameters, amounts)]
        inside = [p.holds(a) and p.sign * a >= 0 for p, a in zip(self.parameters, amounts)]
        return not all(absent) and all(map(operator.or_, absent, inside))
