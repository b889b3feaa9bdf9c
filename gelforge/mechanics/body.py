"""The deformable body: a mesh with a law per region, and its internal forces and tangent at a displacement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from gelforge.mechanics.elements import hex8_gradient
from gelforge.mechanics.kernels import assemble
from gelforge.mechanics.laws import Ogden
from gelforge.mechanics.meshes import HexMesh
from gelforge.mechanics.sparsity import Pattern, build_pattern

NO_TANGENT = np.empty(0)


@dataclass(frozen=True)
class Response:
    """Internal forces of a body at a displacement and element pressures."""

    f_mixed: np.ndarray  # (N, 3) [N] with the given pressures; zero at hanging nodes
    f_condensed: np.ndarray  # (N, 3) [N] with the pressures of the volume change
    p_volume: np.ndarray  # (E,) [MPa] K (theta - 1)
    coupling: np.ndarray  # (E, 8, 3) [mm^2] d(element volume)/du
    energy: float  # mJ
    smallest_J: float  # least det F at a Gauss point


class Body:
    """A mesh of mean-dilatation hexahedra at finite strain; laws and bulk moduli [MPa] are given per region."""

    def __init__(
        self, mesh: HexMesh, laws: dict[str, Ogden], bulk_to_shear: float, pattern: Pattern | None = None
    ):
        self.mesh = mesh
        self.gradient, self.weight = hex8_gradient(mesh.X, mesh.hexahedra)
        self.pattern = pattern or build_pattern(mesh.hexahedra, mesh.fixed, mesh.ties)
        self._assembled = None if self.pattern.condense is None else np.empty(self.pattern.assembled)
        terms = max(len(laws[name].mu) for name in mesh.regions)
        self.mu = np.zeros((len(mesh.regions), terms))
        self.alpha = np.ones((len(mesh.regions), terms))
        for r, name in enumerate(mesh.regions):
            self.mu[r, : len(laws[name].mu)] = laws[name].mu
            self.alpha[r, : len(laws[name].alpha)] = laws[name].alpha
        self.bulk = bulk_to_shear * np.array([laws[name].shear_modulus for name in mesh.regions])
        self.element_bulk = self.bulk[mesh.region]
        self.element_volume = self.weight.sum(axis=1)

    def response(self, u: np.ndarray, pressure: np.ndarray, tangent: np.ndarray = NO_TANGENT) -> Response:
        """Return the response at u (N, 3) [mm] and pressure (E,) [MPa]; fill tangent (nnz,) unless it is empty."""
        E, N = len(self.mesh.hexahedra), len(self.mesh.X)
        f_mixed, f_condensed = np.empty((N, 3)), np.empty((N, 3))
        p_volume, coupling = np.empty(E), np.empty((E, 8, 3))
        condensed = len(tangent) > 0 and self.pattern.condense is not None
        energy, smallest_J = assemble(
            self.gradient, self.weight, self.mesh.hexahedra, self.mesh.region, u, pressure, self.mu, self.alpha, self.bulk,
            self.pattern.element_slots, self._assembled if condensed else tangent, f_mixed, f_condensed, p_volume, coupling,
        )  # fmt: skip
        if condensed:
            tangent[:] = self.pattern.condense @ self._assembled
        return Response(
            self.gathered(f_mixed), self.gathered(f_condensed), p_volume, coupling, energy, smallest_J
        )

    def gathered(self, force: np.ndarray) -> np.ndarray:
        """Return nodal forces (N, 3) with those of hanging nodes handed to the nodes they hang between."""
        return force if self.mesh.ties is None else self.mesh.ties.T @ force

    def spread(self, u: np.ndarray) -> np.ndarray:
        """Return displacements (N, 3) in which hanging nodes follow the nodes they hang between."""
        return u if self.mesh.ties is None else self.mesh.ties @ u

    def linearised_pressure(self, response: Response, du: np.ndarray) -> np.ndarray:
        """Return the element pressures (E,) [MPa] that the linearised volume change of du (N, 3) predicts."""
        growth = np.einsum("eai,eai->e", response.coupling, du[self.mesh.hexahedra])
        return response.p_volume + self.element_bulk / self.element_volume * growth

    def pressure_error(self, response: Response, pressure: np.ndarray) -> float:
        """Return the largest |K (theta - 1) - p| / K, an error of the volume ratio."""
        return float(np.abs((response.p_volume - pressure) / self.element_bulk).max())


class SmallStrainBody(Body):
    """The same body with the linear elasticity of its undeformed state: internal forces K u for every displacement."""

    def __init__(self, mesh: HexMesh, laws: dict[str, Ogden], bulk_to_shear: float):
        super().__init__(mesh, laws, bulk_to_shear)
        zero, no_pressure = np.zeros_like(mesh.X), np.zeros(len(mesh.hexahedra))
        self.tangent = np.empty(len(self.pattern.indices))
        super().response(zero, no_pressure, self.tangent)
        # The reaction needs the rows of the fixed nodes too, so the forces come from a pattern in which nothing is fixed.
        everything = Body(
            mesh, laws, bulk_to_shear, build_pattern(mesh.hexahedra, np.zeros(len(mesh.X), bool), None)
        )
        values = np.empty(len(everything.pattern.indices))
        everything.response(zero, no_pressure, values)
        upper = sp.csr_matrix((values, everything.pattern.indices, everything.pattern.indptr))
        self._stiffness = upper + sp.triu(upper, 1).T

    def response(self, u: np.ndarray, pressure: np.ndarray, tangent: np.ndarray = NO_TANGENT) -> Response:
        """Return the linear response at u (N, 3) [mm]; the element pressures stay zero (they are part of K)."""
        force = self.gathered((self._stiffness @ u.ravel()).reshape(u.shape))
        if len(tangent):
            tangent[:] = self.tangent
        E = len(self.mesh.hexahedra)
        return Response(force, force, np.zeros(E), np.zeros((E, 8, 3)), 0.5 * float(np.vdot(force, u)), 1.0)
