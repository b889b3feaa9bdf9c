"""The deformable body: a mesh with a law per region, and its internal forces and tangent at a displacement."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gelforge.mechanics.bodies.kernels import ASSEMBLE, Assembled, Elements, StepMemory
from gelforge.mechanics.laws.law import NEAREST_LIMIT, PrincipalLaw
from gelforge.mechanics.laws.points import point_constants, point_number
from gelforge.mechanics.linear.sparsity import Pattern, build_pattern
from gelforge.mechanics.meshes.elements import ELEMENTS, element_gradient
from gelforge.mechanics.meshes.mesh import Mesh

# An iterate in which a point keeps less of its volume is shortened. No solution comes near: a nearly incompressible gel
# keeps its volume, and foam that keeps 0.4 of it is admitted (tests/mechanics/test_kernels.py).
LEAST_J = 0.05
NO_TANGENT = np.empty(0)


@dataclass(frozen=True)
class Response:
    """Internal forces of a body at a displacement and element pressures."""

    f_mixed: np.ndarray  # (N, 3) [N] with the given pressures; zero at hanging nodes
    f_condensed: np.ndarray  # (N, 3) [N] with the pressures of the volume change
    p_volume: np.ndarray  # (E,) [MPa] K (theta - 1)
    coupling: np.ndarray  # (E, A, 3) [mm^2] d(element volume)/du
    energy: float  # mJ
    smallest_J: float  # least det F at a quadrature point
    largest_extension: float = 0.0  # largest share of a law's limit at a point; 1: no stress exists beyond

    @property
    def admissible(self) -> bool:
        """Whether every point keeps enough of its volume and stays within the limit of its law."""
        return self.smallest_J > LEAST_J and self.largest_extension < NEAREST_LIMIT


def bulk_to_shear_of(poissons_ratio: float) -> float:
    """Return K/mu = 2 (1 + nu) / (3 (1 - 2 nu)) of the undeformed state.

    Parameters
    ----------
    poissons_ratio : float
        nu, above -1 and below 0.5.

    Returns
    -------
    float
        [-].

    Raises
    ------
    ValueError
        For another Poisson's ratio.
    """
    if not -1 < poissons_ratio < 0.5:
        raise ValueError(f"Poisson's ratio is {poissons_ratio:g}; between -1 and 0.5 is needed")
    return 2 * (1 + poissons_ratio) / (3 * (1 - 2 * poissons_ratio))


class Body:
    """A mesh of mean-dilatation elements at finite strain.

    Laws are given per region, K/mu as one number or per region; stiffness (E,), 1 without, multiplies the moduli of each
    element, bulk modulus included unless bulk_stiffness (E,) multiplies that one. prestretch (3, 3) per region is the
    deformation gradient of the mesh as it lies, from the state without stress.
    """

    remembers = False  # its stresses depend on the way to a state
    gradient: np.ndarray  # (E, Q, A, 3) [1/mm] dN/dX at the points
    weight: np.ndarray  # (E, Q) [mm^3]
    pattern: Pattern
    _memory = StepMemory()

    def __init__(
        self,
        mesh: Mesh,
        laws: Mapping[str, PrincipalLaw],
        bulk_to_shear: float | Mapping[str, float],
        pattern: Pattern | None = None,
        stiffness: np.ndarray | None = None,
        bulk_stiffness: np.ndarray | None = None,
        prestretch: Mapping[str, np.ndarray] | None = None,
        like: Body | None = None,
    ):
        """like: a body with the same elements, whose pattern, and gradients where nodes are the same, are shared."""
        self.mesh, self.laws = mesh, dict(laws)
        if like is not None and like.mesh.X is mesh.X and like.at_rest and not prestretch:
            self.gradient, self.weight = like.gradient, like.weight
        else:
            self.gradient, self.weight = element_gradient(mesh.X, mesh.elements)
        self.rest = np.tile(np.eye(3), (len(mesh.regions), 1, 1))  # F at u = 0
        for name, F in (prestretch or {}).items():
            self._stretch_before(mesh.regions.index(name), np.asarray(F, dtype=float))
        pattern = pattern or (like.pattern if like is not None else None)
        self.pattern = pattern or build_pattern(mesh.elements, mesh.fixed, mesh.ties)
        self._assemble = ASSEMBLE[mesh.elements.shape[1]]
        self._assembled = np.empty(0 if self.pattern.condense is None else self.pattern.assembled)
        by_region = [laws[name] for name in mesh.regions]
        self.law = np.array([point_number(law) for law in by_region])
        self.constants = point_constants(by_region)
        self.stiffness = _stiffness(stiffness, len(mesh.elements))
        shear = np.array([law.shear_modulus for law in by_region])
        if not isinstance(bulk_to_shear, Mapping):
            bulk_to_shear = dict.fromkeys(mesh.regions, bulk_to_shear)
        self.bulk = shear * [bulk_to_shear[name] for name in mesh.regions]  # (R,)
        self.element_shear = shear[mesh.region] * self.stiffness  # (E,) [MPa] at rest
        bulk_factor = (
            self.stiffness if bulk_stiffness is None else _stiffness(bulk_stiffness, len(mesh.elements))
        )
        self.element_bulk = self.bulk[mesh.region] * bulk_factor
        local = ELEMENTS[mesh.elements.shape[1]].local_bulk_to_shear * shear[mesh.region] * self.stiffness
        # equal: every point for itself, as a soft body may
        self.local_bulk = np.minimum(local, self.element_bulk)
        self.element_volume = self.weight.sum(axis=1)

    def _stretch_before(self, region: int, F: np.ndarray) -> None:
        """Count the gradients of a region from its state without stress: dN/dX_0 = dN/dX F."""
        J = np.linalg.det(F)
        if not J > 0:
            raise ValueError(f"prestretch of {self.mesh.regions[region]} has det F = {J:g}; > 0 is needed")
        inside = self.mesh.region == region
        self.gradient[inside] = self.gradient[inside] @ F
        self.weight[inside] /= J
        self.rest[region] = F

    def deformation_gradient(self, u: np.ndarray) -> np.ndarray:
        """Return F (E, Q, 3, 3) at u (N, 3) [mm], from the state without stress."""
        H = np.einsum("eai,eqaj->eqij", u[self.mesh.elements], self.gradient, optimize=True)
        return H + self.rest[self.mesh.region][:, None]

    @property
    def at_rest(self) -> bool:
        """Whether the undeformed state has no residual stretch."""
        return bool((self.rest == np.eye(3)).all())

    def response(self, u: np.ndarray, pressure: np.ndarray, tangent: np.ndarray = NO_TANGENT) -> Response:
        """Return the response at u (N, 3) [mm] and pressure (E,) [MPa]; fill tangent (nnz,) unless it is empty."""
        E, N = len(self.mesh.elements), len(self.mesh.X)
        condense = self.pattern.condense if len(tangent) else None
        elements = Elements(
            self.gradient, self.weight, self.mesh.elements, self.mesh.region, self.law, self.constants, self.stiffness,
            self.element_bulk, self.local_bulk, self.rest, self.pattern.element_slots,
        )  # fmt: skip
        values = tangent if condense is None else self._assembled
        out = Assembled(
            values, np.empty((N, 3)), np.empty((N, 3)), np.empty(E), np.empty((*self.mesh.elements.shape, 3))
        )
        energy, smallest_J, extension = self._assemble(elements, u, pressure, self._memory, out)
        if condense is not None:
            tangent[:] = condense @ self._assembled
        f_mixed, f_condensed = self.gathered(out.f_mixed), self.gathered(out.f_condensed)
        return Response(f_mixed, f_condensed, out.p_volume, out.coupling, energy, smallest_J, extension)

    def part(self, elements: np.ndarray, mesh: Mesh) -> Body:
        """Return some elements (n,) of the body by themselves, for responses without tangent; mesh: theirs alone."""
        some = copy.copy(self)
        some.mesh = mesh
        for name in ("gradient", "weight", "stiffness", "element_bulk", "local_bulk", "element_volume"):
            setattr(some, name, np.ascontiguousarray(getattr(self, name)[elements]))
        return some

    def gathered(self, force: np.ndarray) -> np.ndarray:
        """Return nodal forces (N, 3) with those of hanging nodes handed to the nodes they hang between."""
        return force if self.mesh.ties is None else self.mesh.ties.T @ force

    def spread(self, u: np.ndarray) -> np.ndarray:
        """Return displacements (N, 3) in which hanging nodes follow the nodes they hang between."""
        return u if self.mesh.ties is None else self.mesh.ties @ u

    def linearised_pressure(self, response: Response, du: np.ndarray) -> np.ndarray:
        """Return the element pressures (E,) [MPa] that the linearised volume change of du (N, 3) predicts."""
        growth = np.einsum("eai,eai->e", response.coupling, du[self.mesh.elements])
        return response.p_volume + self.element_bulk / self.element_volume * growth

    def pressure_error(self, response: Response, pressure: np.ndarray) -> float:
        """Return the largest |K (theta - 1) - p| / K, an error of the volume ratio."""
        return float(np.abs((response.p_volume - pressure) / self.element_bulk).max())


class SmallStrainBody(Body):
    """The same body with the linear elasticity of its undeformed state: internal forces K u for every displacement."""

    def __init__(
        self,
        mesh: Mesh,
        laws: Mapping[str, PrincipalLaw],
        bulk_to_shear: float | Mapping[str, float],
        stiffness: np.ndarray | None = None,
        bulk_stiffness: np.ndarray | None = None,
    ):
        super().__init__(mesh, laws, bulk_to_shear, stiffness=stiffness, bulk_stiffness=bulk_stiffness)
        zero, no_pressure = np.zeros_like(mesh.X), np.zeros(len(mesh.elements))
        self.tangent = np.empty(len(self.pattern.indices))
        super().response(zero, no_pressure, self.tangent)
        # The reaction needs the rows of the fixed nodes too, so the forces come from a pattern in which nothing is fixed.
        unheld = build_pattern(mesh.elements, np.zeros(len(mesh.X), bool), None)
        everything = Body(mesh, laws, bulk_to_shear, unheld, stiffness, bulk_stiffness)
        values = np.empty(len(everything.pattern.indices))
        everything.response(zero, no_pressure, values)
        self._stiffness = everything.pattern.symmetric(values)

    def response(self, u: np.ndarray, pressure: np.ndarray, tangent: np.ndarray = NO_TANGENT) -> Response:
        """Return the linear response at u (N, 3) [mm]; the element pressures stay zero (they are part of K)."""
        force = self.gathered((self._stiffness @ u.ravel()).reshape(u.shape))
        if len(tangent):
            tangent[:] = self.tangent
        E = len(self.mesh.elements)
        no_coupling = np.zeros((*self.mesh.elements.shape, 3))
        return Response(force, force, np.zeros(E), no_coupling, 0.5 * float(np.vdot(force, u)), 1.0)


def _stiffness(factor: np.ndarray | None, E: int) -> np.ndarray:
    """Return the factors (E,) on the elements' moduli, checked."""
    if factor is None:
        return np.ones(E)
    factor = np.ascontiguousarray(factor, dtype=float)
    if factor.shape != (E,):
        raise ValueError(f"stiffness has shape {factor.shape}; one factor for each of {E} elements is needed")
    if not (np.isfinite(factor).all() and factor.min() > 0):
        worst = int(np.argmin(np.where(np.isfinite(factor), factor, -np.inf)))
        raise ValueError(
            f"stiffness of element {worst} is {factor[worst]:g}; > 0 is needed, a void has a small one such as 1e-4"
        )
    return factor
