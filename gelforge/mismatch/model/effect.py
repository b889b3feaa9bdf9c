"""What one kind of left-out physics is: its parameters and priors, where it enters, what it may look at, and its words."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import PchipInterpolator, PPoly

from gelforge.config import Camera, Study
from gelforge.mismatch.readings.observations import Observations

FAMILIES = (
    *("material", "history", "contact", "geometry", "kinematics", "force sensor", "camera", "analyst"),
    "simplification",
)
ON_BOUND = 2e-3  # of a bound, nearer to which a value is on it: fits keep half of that from it (refit.INSIDE)


@dataclass(frozen=True)
class Curves:
    """A quantity (3,) of the base over depth, loading, at every site: 0 at depth 0, monotone cubic between solved depths."""

    depths: tuple[np.ndarray, ...]  # per site, (D,) increasing [mm]
    values: tuple[np.ndarray, ...]  # per site, (D, 3)

    def at(self, site: int, depth: np.ndarray, slope: bool = False) -> np.ndarray:
        """Return the quantity (..., 3) at depths [mm], 0 above the surface, or its slope per mm."""
        depth = np.asarray(depth, dtype=float)
        values = self._curve(site, slope)(np.maximum(depth, 0.0))
        return np.where((depth > 0)[..., None], values, 0.0)

    def _curve(self, site: int, slope: bool) -> PPoly:
        """Return the polynomials of a site, built once: that takes ten times as long as reading them."""
        if (site, slope) not in self._built:
            knots = np.concatenate([[0.0], self.depths[site]])
            values = np.vstack([np.zeros(3), self.values[site]])
            curve = PchipInterpolator(knots, values, axis=0, extrapolate=True)
            self._built[site, slope] = curve.derivative() if slope else curve
        return self._built[site, slope]

    @cached_property
    def _built(self) -> dict[tuple[int, bool], PPoly]:
        return {}


@dataclass(frozen=True)
class Context:
    """The nominal model with the readings.

    derivatives: by "effect" or "effect.parameter", d force / d theta (N per unit) of effects that the solver knows.
    """

    study: Study
    observations: Observations
    force: np.ndarray  # (R, 3) [N] base forces at the readings
    curves: Curves  # base forces
    derivatives: Mapping[str, Curves]  # during loading
    at_readings: Mapping[str, np.ndarray] = field(default_factory=dict)  # (R, 3) the same, unloading included

    @classmethod
    def before_readings(cls, study: Study) -> Context:
        """Return the context of a study in which nothing is recorded yet."""
        return cls(study, Observations.none(), np.zeros((0, 3)), Curves((), ()), {})

    def derivative(self, name: str) -> np.ndarray:
        """Return d force / d theta (R, 3) at the readings; as during loading where the unloading is not known."""
        if name in self.at_readings:
            return self.at_readings[name]
        return self.on_readings(self.derivatives[name])

    def with_derivative(self, name: str) -> Context:
        """Return the context in which all derivatives but one are zero."""
        curves = {
            key: one if key == name else replace(one, values=tuple(0.0 * v for v in one.values))
            for key, one in self.derivatives.items()
        }
        at_readings = {key: v if key == name else 0.0 * v for key, v in self.at_readings.items()}
        return replace(self, derivatives=curves, at_readings=at_readings)

    def slope(self) -> np.ndarray:
        """Return d force / d depth (R, 3) [N/mm] at the readings, as during loading curve."""
        return self.on_readings(self.curves, slope=True)

    def on_readings(self, curves: Curves, slope: bool = False) -> np.ndarray:
        """Return curves (R, 3) at the site and depth of each reading."""
        table = self.observations.table
        values = np.zeros((len(table), 3))
        for site, rows in table.groupby("site").indices.items():
            values[rows] = curves.at(site, table["depth_mm"].to_numpy()[rows], slope)
        return values


# What is scanned: a place (refits move it between those that were tried), a time constant
Hyperparameters = Mapping[str, float | str]


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect; 0 is its absence, and a range that begins at 0 leaves one sign only."""

    name: str
    unit: str
    width: float  # standard deviation of its prior: a plausible value
    bounds: tuple[float, float]  # the physical range
    source: str  # of width and bounds
    closed: bool = field(default=False, kw_only=True)  # a bound other than 0 is physical, as an empty ball is

    @property
    def sign(self) -> int:
        """Return the only physical sign, 1 or -1; 0: both."""
        return int(self.bounds[0] == 0) - int(self.bounds[1] == 0)

    def holds(self, a: float) -> bool:
        """Return whether a value lies inside the bounds and off them, or on a bound that is physical."""
        low, high = (bound * (1 - ON_BOUND) if np.isfinite(bound) else bound for bound in self.bounds)
        return low < a < high or (self.closed and a != 0 and a in self.bounds)


def no_hyperparameters(context: Context) -> list[Hyperparameters]:
    """Return the grid of an effect that has nothing to scan."""
    return [{}]


def unturned(turn: np.ndarray) -> np.ndarray:
    """Return the turn of a value that is the same from all sides of a square."""
    return np.eye(1)


def everywhere(study: Study) -> bool:
    """Return that an effect may be left out of any study."""
    return True


@dataclass(frozen=True)
class Effect:
    """One kind of left-out physics. Values (P,) are in the parameters' units; all zero is the base bit for bit.

    to_study puts it into the finite elements. to_forces gives the forces (R, 3) on the sensor as read with the effect, from
    those without: exact for the force sensor and the clock, a first approximation for what is solved. to_camera changes the
    camera that looks at the particles.
    """

    name: str
    family: str
    parameters: tuple[Parameter, ...]
    # What it is, as a clause; then, where one value says it all, more and less of it
    means: tuple[str, ...] = ()
    signature: str = ""  # what it does to readings, in words
    separated_by: str = ""  # the experiment that distinguishes it from others
    depends_on: tuple[str, ...] = ()  # the effects whose derivatives it is made of
    to_study: Callable[[Study, Hyperparameters, Sequence[float]], Study] | None = None
    to_forces: Callable[[Context, Hyperparameters, np.ndarray, Sequence[float]], np.ndarray] | None = None
    to_camera: Callable[[Study, Camera, Sequence[float]], Camera] | None = None
    grid: Callable[[Context], list[Hyperparameters]] = no_hyperparameters
    # (2, 2) of D4 -> (P, P): how values turn with the sensor
    turned: Callable[[np.ndarray], np.ndarray] = unturned
    applies: Callable[[Study], bool] = everywhere  # the sensor has what it is about
    binary: bool = False  # values are 0 and 1 only
    history: bool = False  # every indentation is a path of its own, in time
    path_dependent: bool = False  # an indentation changes those after it: all are solved, one after the other
    mesh_changes: bool = False  # its derivative is a difference of two solutions on its own mesh
    step: float = 1e-2  # of a plausible value, at which its derivative is taken
    # The value, to either side, across which a difference is taken where there is no other derivative.
    across: Callable[[Study], float] | None = None
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

    @property
    def signs(self) -> np.ndarray:
        """Return the only physical signs (P,); 0: both."""
        return np.array([parameter.sign for parameter in self.parameters])

    def unit_step(self, k: int, share: float) -> tuple[float, ...]:
        """Return values (P,) of which number k alone is there: a share of a plausible one, 1 of what is on or off."""
        size = 1.0 if self.binary else share * self.parameters[k].width * (self.parameters[k].sign or 1)
        return tuple(size if number == k else 0.0 for number in range(len(self.parameters)))

    def in_range(self, theta: Sequence[float] | np.ndarray) -> bool:
        """Return whether every value has its physical sign and lies inside its bounds, or on one that is physical.

        Of several values of one sign some may be absent.
        """
        absent = [p.sign != 0 and a == 0 for p, a in zip(self.parameters, theta)]
        inside = [p.holds(a) and p.sign * a >= 0 for p, a in zip(self.parameters, theta)]
        return not all(absent) and all(map(operator.or_, absent, inside))

    def in_words(self, hyperparameters: Hyperparameters, theta: Sequence[float]) -> str:
        """Return what it means at its parameter values, and where it lies if it has a place."""
        # of friction, where the simulation has none; 0: where it has some
        coefficient = hyperparameters.get("coefficient")
        if coefficient is not None:
            real, simulated = ("friction", "none") if coefficient else ("no friction", "some")
            return f"there is {real}, and the simulation has {simulated}"
        place = ""
        if "x_mm" in hyperparameters:
            place = f" near ({hyperparameters['x_mm']:.3g}, {hyperparameters['y_mm']:.3g}) mm"
        if len(self.means) == 1 or not theta[0]:
            return self.means[0] + place
        value, unit = abs(float(theta[0])), self.parameters[0].unit
        clause = self.means[1 if theta[0] > 0 else 2]
        return clause.format(share=f"{100 * value:.2g} %", size=f"{value:.2g} {unit}") + place
