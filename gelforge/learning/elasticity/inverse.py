"""Inverse elasticity: the contact forces that explain a flow best, within Coulomb's cone of friction."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gelforge.learning.basis.scaling import input_flow

# Forces that made a flow are found again (tests/learning/test_elasticity.py):
# Of the operator's mean squared column: the flow that a force explains is off by a fifth (large strains, the search's
# smoothing) over lengths of some bins, so that finer detail of the forces is not in it.
RIDGE = 0.1
# Of the largest pressure's correlation with the flow: an even pressure hardly moves an incompressible layer and the flow
# does not tell it, so of all that explain the flow the forces of least total pressure are taken. It is relative, as the
# error is.
SPARSITY = 0.015
PENALTY = 2.0  # Of the splitting, of the mean squared column. Measured: fewest iterations among 0.1 to 16.
RELAXATION = 1.8  # over-relaxation, of which 1.5 to 1.8 is usual (Boyd et al. 2011, section 3.4.3)
ITERATIONS = 30  # from nothing. Measured: totals within 0.2 % (median) of the solution.
# from the frame before: totals within 2 % of the solution (tests/learning/test_elasticity.py)
WARM_ITERATIONS = 5
LEAST_SHARE = 0.02  # of RIDGE: squared singular values below it change no force


class State(NamedTuple):
    """Forces and scaled multipliers (n, 3 B) after some iterations; the next rows may start from them."""

    force: np.ndarray
    multiplier: np.ndarray


@dataclass(frozen=True)
class Inverse:
    """The flow's operator by its singular values, and the coefficient of friction.

    Forces f minimise |G f - y|^2 / 2 + ridge |f|^2 / 2 + t sum |f_z| over f_z <= 0, |f_xy| <= mu |f_z|, by the alternating
    direction method of multipliers (Boyd et al. 2011, doi:10.1561/2200000016, section 3.4.3).
    """

    left: np.ndarray  # (2 r^2, K) float32, orthonormal
    singular: np.ndarray  # (K,) float32 [px/N]
    right: np.ndarray  # (3 B, K) float32, orthonormal
    friction: float
    unit_N: np.ndarray = field(default_factory=lambda: np.ones(3, np.float32))  # (3,) of a network's inputs

    @classmethod
    def of(cls, operator: np.ndarray, friction: float) -> Inverse:
        """Return the inverse of an operator (2, r^2, B, 3) [px/N]; singular values that change no force are left out."""
        G = operator.reshape(operator.shape[0] * operator.shape[1], -1).astype(np.float64)
        squares, right = np.linalg.eigh(G.T @ G)
        squares, right = squares[::-1], right[:, ::-1]
        kept = squares > LEAST_SHARE * RIDGE * squares.sum() / len(squares)
        singular, right = np.sqrt(squares[kept]), right[:, kept]
        left = G @ right / singular
        left, singular, right = (np.ascontiguousarray(part, np.float32) for part in (left, singular, right))
        return cls(left, singular, right, float(friction))

    def forces(self, feature: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of features (n, 2 r^2), each from nothing."""
        flow = input_flow(np.atleast_2d(feature), "vector")
        parts = [self.solve(flow[start : start + 64]).force for start in range(0, len(flow), 64)]
        return np.concatenate([np.empty((0, len(self.right)), np.float32), *parts]).reshape(len(flow), -1, 3)

    def inputs(self, feature: np.ndarray) -> np.ndarray:
        """Return the forces (n, 3 B) float32 of features (n, 2 r^2) in units of unit_N, as a network reads them."""
        return (self.forces(feature) / self.unit_N).reshape(len(feature), -1)

    @cached_property
    def step(self) -> tuple[np.float32, np.float32, np.ndarray]:
        """The penalty, its sum with the ridge [px^2/N^2], and V (3 B, K) times what a least-squares step takes of it."""
        mean_square = (self.singular.astype(float) ** 2).sum() / len(self.right)
        ridge = (RIDGE + PENALTY) * mean_square
        taken = self.right * (self.singular**2 / (self.singular**2 + ridge))
        return np.float32(PENALTY * mean_square), np.float32(ridge), taken.astype(np.float32)

    def solve(self, flow: np.ndarray, iterations: int = ITERATIONS, start: State | None = None) -> State:
        """Return the state after some iterations for flow (n, 2 r^2) float32 [px], u then v of the regions."""
        penalty, ridge, taken = self.step
        given = self.explained(flow)
        force, multiplier = start or State(np.zeros_like(given), np.zeros_like(given))
        for _ in range(iterations):
            pulled = given + penalty * (force - multiplier)
            free = (pulled - (pulled @ taken) @ self.right.T) / ridge
            ahead = RELAXATION * free + (1 - RELAXATION) * force + multiplier
            force = in_cone(ahead, self.friction)
            multiplier = ahead - force
        return State(force, multiplier)

    def explained(self, flow: np.ndarray) -> np.ndarray:
        """Return G^T y (n, 3 B) of flow (n, 2 r^2), with the penalty on pressure taken off."""
        given = ((flow @ self.left) * self.singular) @ self.right.T
        pressure = given.reshape(len(given), -1, 3)[..., 2]  # a view
        pressure += SPARSITY * np.maximum(-pressure, 0).max(axis=1, keepdims=True)
        return given


def in_cone(force: np.ndarray, friction: float) -> np.ndarray:
    """Return the nearest forces (n, 3 B) with f_z <= 0 and |f_xy| <= mu |f_z|."""
    parts = force.reshape(len(force), -1, 3)
    push, slide = -parts[..., 2], np.hypot(parts[..., 0], parts[..., 1])
    inside = slide <= friction * push
    along = np.maximum((push + friction * slide) / (1 + friction**2), 0)  # zero where the dual cone has it
    scale = np.where(inside, 1, friction * along / np.maximum(slide, np.float32(1e-30)))
    nearest = np.empty_like(parts)
    nearest[..., :2] = parts[..., :2] * scale[..., None]
    nearest[..., 2] = -np.where(inside, push, along)
    return nearest.reshape(force.shape)
