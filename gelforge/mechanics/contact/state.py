"""States of a pressed body, and the constants of the iteration that finds them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Settings:
    """Constants of the iteration, pure numbers, and of the contact's physics in mm, N and MPa."""

    friction: float = 0.45
    normal_augmentation: float = 50.0  # of shear modulus over element size: how fast gaps close, not where to
    tangential_augmentation: float = 1000.0  # the same for slip
    # Norm of unbalanced forces, and of friction's error, over norm of contact forces
    force_tolerance: float = 1e-6
    gap_tolerance: float = 3e-4  # penetration over element size
    volume_tolerance: float = 1e-6  # error of an element's volume ratio
    longest_step: float = 1.0  # of the indenter over the element size, where friction makes the path matter
    max_iterations: int = 40
    max_halvings: int = 4
    initial_normals: bool = False
    # Share of the faces' mean distance inside the indenter by which nodes are pressed further
    facets: float = 0.0
    friction_exponents: tuple[float, ...] = ()  # n_k of mu times (1 + p / p_k)^-n_k
    friction_pressures: tuple[float, ...] = ()  # p_k, MPa
    adhesion_work: float = 0.0  # N/mm, of separation
    adhesion_approach: float = 0.0  # N/mm, before the first touch
    adhesion_range: float = 0.05  # mm
    film_thickness: float = 0.0  # mm, of what gives way between indenter and surface
    film_pressure: float = 0.01  # MPa, at which half of it has

    @property
    def adheres(self) -> bool:
        """Whether the surface sticks to the indenter without being pressed."""
        return max(self.adhesion_work, self.adhesion_approach) > 0


@dataclass(frozen=True)
class State:
    """A converged state (or the undeformed start)."""

    centre: np.ndarray  # (3,) of the indenter [mm], or (6,) with its rotation vector [rad] after it
    u: np.ndarray  # (N, 3) displacement [mm]
    pressure: np.ndarray  # (E,) element pressure [MPa]
    contact_pressure: np.ndarray  # (S,) per undeformed area [MPa]
    gap: np.ndarray  # (S,) [mm]
    normal_force: np.ndarray  # (S, 3) of the indenter on the surface nodes [N]
    friction_force: np.ndarray  # (S, 3) [N]
    contact_state: np.ndarray  # (S,) open, stick, slip
    # (n_fixed, 3) internal forces at the fixed nodes, the base's forces on the body [N]
    fixed_force: np.ndarray
    energy: float = 0.0  # mJ
    iterations: int = 0
    factorisations: int = 0
    residual: float = 0.0  # norm of unbalanced over norm of contact forces
    smallest_J: float = 1.0
    touched: np.ndarray | None = None  # (S,) bool, nodes that have been in contact; None: none has
    travel: np.ndarray | None = None  # the indenter's last step, as centre; None: there was none
    moved: np.ndarray | None = None  # (S, 3) of the surface nodes in that step [mm]
    memory: Any = None  # of a body that remembers (mechanics.bodies.memory.Memory)

    @property
    def force(self) -> np.ndarray:
        """The total contact force (3,) [N] on the body."""
        return (self.normal_force + self.friction_force).sum(axis=0)

    @property
    def reaction(self) -> np.ndarray:
        """The total force (3,) [N] of the base on the body, summed from internal forces."""
        return self.fixed_force.sum(axis=0)
