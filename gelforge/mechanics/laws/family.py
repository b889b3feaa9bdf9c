r"""What a fit needs to know about a law: its unknowns, bounds, starts and analytic Jacobian.

A family describes a law by unknowns theta in which its constraints are simple bounds, and by parameters with the
units of files (kPa). Stress at measured states is s (beta_1 - beta_3) (laws.homogeneous).
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from gelforge.mechanics.laws.homogeneous import StressPoints
from gelforge.mechanics.laws.law import PrincipalLaw


class Family(ABC):
    """A law with its unknowns theta (p,); everything that a fit needs to know about it."""

    name: str  # in files and configurations
    title: str  # in tables and figures
    kind: type[PrincipalLaw]
    parameters: tuple[str, ...]  # as in law.json, with their unit
    logarithmic: tuple[bool, ...]  # parameters whose sign is fixed: intervals are those of the logarithm
    is_linear = False  # the stress is linear in theta
    modulus_per_parameter: tuple[float, ...]  # dE / d parameters, where it does not depend on them
    bound_means: str  # what to do when an unknown runs to its bound
    simpler: str | None = None  # the family that it becomes when the curves do not determine its last term

    def holds(self, law: PrincipalLaw) -> bool:
        """Return whether a law is one of this family."""
        return isinstance(law, self.kind)

    @abstractmethod
    def law(self, theta: np.ndarray) -> PrincipalLaw:
        """Return the law [MPa]."""

    @abstractmethod
    def values(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parameters (p,) in the units of files and their derivatives d parameters / d theta (p, p)."""

    @abstractmethod
    def unknowns(self, values: np.ndarray) -> np.ndarray:
        """Return theta (p,) of parameters (p,) in the units of files."""

    @abstractmethod
    def stress(self, points: StressPoints, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the nominal stress (n,) [MPa] and its derivatives by theta (n, p)."""

    @abstractmethod
    def bounds(self, points: StressPoints, stiffness: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the lowest and highest theta; stiffness [MPa] is a shear modulus of the order of the curves'."""

    @abstractmethod
    def starts(self, points: StressPoints, weight: np.ndarray, stress: np.ndarray, stiffness: float) -> list:
        """Return start vectors, the most promising first; the same for the same curves."""

    def modulus_gradient(self, values: np.ndarray) -> np.ndarray:
        """Return the derivatives (p,) of Young's modulus [kPa] by the parameters in the units of files."""
        return np.array(self.modulus_per_parameter)

    def ordered(self, theta: np.ndarray) -> np.ndarray:
        """Return theta with exchangeable terms in one order, so that the same law has the same parameters."""
        return theta

    def unit(self, parameter: str) -> str:
        """Return the unit of a parameter as its name says."""
        return "kPa" if parameter.endswith("_kPa") else "1"

    def law_of(self, values: np.ndarray) -> PrincipalLaw:
        """Return the law [MPa] of parameters in the units of files."""
        return self.law(self.unknowns(np.asarray(values, dtype=float)))

    def parameters_of(self, law: PrincipalLaw) -> np.ndarray:
        """Return the parameters (p,) of a law in the units of files; attributes of the law have their names."""
        units = [1e3 if name.endswith("_kPa") else 1.0 for name in self.parameters]
        return np.array([getattr(law, name.removesuffix("_kPa")) for name in self.parameters]) * units


class LinearFamily(Family):
    """A law whose constants [MPa] enter the stress linearly; theta = constants. Only the first must be positive."""

    is_linear = True
    free: tuple[bool, ...]  # constants that may be negative

    def law(self, theta):
        return self.kind(*(float(c) for c in theta))

    def values(self, theta):
        return theta * 1e3, np.eye(len(theta)) * 1e3

    def unknowns(self, values):
        return values / 1e3

    def stress(self, points, theta):
        columns = self.columns(points)
        return columns @ theta, columns

    def bounds(self, points, stiffness):
        low = np.where(self.free, -np.inf, 0.0)
        low[0] = stiffness * 1e-6
        return low, np.full(len(low), np.inf)

    def starts(self, points, weight, stress, stiffness):
        from scipy import optimize  # slow to import: jobs that only read a law do without

        columns = weight[:, None] * self.columns(points)
        length = np.linalg.norm(columns, axis=0)
        low, high = (b * length for b in self.bounds(points, stiffness))
        solution = optimize.lsq_linear(
            columns / length, weight * stress, (low, high), method="bvls", tol=1e-15
        )
        return [np.maximum(solution.x / length, self.bounds(points, stiffness)[0])]

    @abstractmethod
    def columns(self, points: StressPoints) -> np.ndarray:
        """Return the stress per unit of each constant (n, p)."""


def first_invariant(points: StressPoints) -> np.ndarray:
    """Return the stress (n,) per unit of W_1 = dW/dI_1: 2 s (lam_1^2 - lam_3^2)."""
    return 2 * points.scale * (points.lam[:, 0] ** 2 - points.lam[:, 2] ** 2)
