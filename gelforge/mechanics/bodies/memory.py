r"""A body that remembers: finite-strain viscoelasticity by overstresses, and Mullins softening.

Next to the law's isochoric stress S in material form, which holds at rest, every branch k carries an overstress with

.. math:: \dot Q_k + Q_k / \tau_k = \gamma_k \dot S

(Simo 1987, doi 10.1016/0045-7825(87)90107-1; Holzapfel 2000, sec. 6.10). With Q_k = gamma_k h_k the midpoint recurrence

.. math:: h_k^{n+1} = e^{-\Delta t/\tau_k} h_k^n + e^{-\Delta t/2\tau_k} (S^{n+1} - S^n)

makes the stress of a step that of the law times a gain plus a stress that is frozen during the step, both of a potential:
the tangent is symmetric, and a stress at constant strain relaxes exactly. Softening (Ogden & Roxburgh 1999, doi
10.1098/rspa.1999.0431) multiplies S by eta(W, peak), peak being the largest W that the point has seen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from gelforge.mechanics.bodies.body import Body
from gelforge.mechanics.bodies.kernels import ASSEMBLE_WITH_MEMORY, StepMemory
from gelforge.mechanics.laws.law import DEVIATOR
from gelforge.mechanics.laws.softening import lost_share

# of the six components of a symmetric tensor
PAIRS = np.array([[0, 0], [1, 1], [2, 2], [0, 1], [1, 2], [0, 2]])


@dataclass(frozen=True)
class Relaxation:
    """Branches of a region: overstress moduli over the law's [-] and relaxation times [s]."""

    moduli: tuple[float, ...]
    times: tuple[float, ...]


@dataclass(frozen=True)
class Softening:
    """Ogden-Roxburgh's eta = 1 - amount erf((peak - W) / (m + beta peak)); m [MPa]."""

    amount: float
    m: float
    beta: float = 0.0


@dataclass(frozen=True)
class Memory:
    """What the quadrature points of a body remember of a converged state; stresses without the elements' factors."""

    time: float  # s
    stress: np.ndarray  # (E, Q, 6) [MPa] S, softened
    branches: np.ndarray  # (B, E, Q, 6) [MPa] h_k
    peak: np.ndarray  # (E, Q) [MPa]


class RememberingBody(Body):
    """A body whose regions relax or soften, at finite strain."""

    remembers = True

    def __init__(
        self,
        mesh,
        laws,
        bulk_to_shear,
        relaxation: Mapping[str, Relaxation],
        softening: Mapping[str, Softening],
        peak: np.ndarray | None = None,
        **body,
    ):
        """peak (E, Q) [MPa]: the largest energy densities that earlier indentations have left; none without."""
        super().__init__(mesh, laws, bulk_to_shear, **body)
        self._assemble = ASSEMBLE_WITH_MEMORY[mesh.elements.shape[1]]
        R, shape = len(mesh.regions), self.weight.shape
        B = max([len(r.moduli) for r in relaxation.values()], default=0)
        self.moduli, self.times = np.zeros((R, B)), np.ones((R, B))
        self.softening = np.zeros((R, 3))
        self.softening[:, 1] = 1.0
        for r, name in enumerate(mesh.regions):
            if name in relaxation:
                k = len(relaxation[name].moduli)
                self.moduli[r, :k], self.times[r, :k] = relaxation[name].moduli, relaxation[name].times
            if name in softening:
                self.softening[r] = softening[name].amount, softening[name].m, softening[name].beta
        self.softened = (self.softening[:, 0] > 0)[mesh.region]  # (E,)
        self.forget(np.zeros(shape) if peak is None else peak)

    def forget(self, peak: np.ndarray) -> None:
        """Start from the state at rest with peaks (E, Q) [MPa] that earlier indentations have left."""
        self.initial = self._at_rest(np.array(peak, dtype=float))
        self.begin(self.initial, 0.0)

    def _at_rest(self, peak: np.ndarray) -> Memory:
        none = np.zeros((*self.weight.shape, 6))
        start = Memory(0.0, none, np.zeros((self.moduli.shape[1], *none.shape)), peak)
        if self.at_rest:
            return start
        # A residual stretch has been there for long: nothing of it relaxes any more.
        stress, _ = self._stress(np.zeros_like(self.mesh.X), peak)
        return replace(start, stress=stress)

    def begin(self, memory: Memory, time: float) -> None:
        """Take the step from a memory to a time [s] as that in which `response` is asked for."""
        duration = time - memory.time
        if duration < 0:
            raise ValueError(
                f"time runs backwards, from {memory.time:g} to {time:g} s; order the path by time"
            )
        region = self.mesh.region
        decay, half = np.exp(-duration / self.times), np.exp(-duration / (2 * self.times))  # (R, B)
        gain = 1 + (self.moduli * half).sum(axis=1)
        frozen = np.zeros((*self.weight.shape, 6))
        for k, h in enumerate(memory.branches):
            rate = self.moduli[region, k][:, None, None]
            frozen += rate * (
                decay[region, k][:, None, None] * h - half[region, k][:, None, None] * memory.stress
            )
        self._step = memory, time, decay, half
        self._memory = StepMemory(gain, frozen, memory.peak, self.softening)

    def remember(self, u: np.ndarray) -> Memory:
        """Return the memory at the end of the present step, at the equilibrium u (N, 3) [mm]."""
        memory, time, decay, half = self._step
        region = self.mesh.region
        stress, energy = self._stress(u, memory.peak)
        branches = np.empty_like(memory.branches)
        for k, h in enumerate(memory.branches):
            change = half[region, k][:, None, None] * (stress - memory.stress)
            branches[k] = decay[region, k][:, None, None] * h + change
        peak = np.where(self.softened[:, None], np.maximum(memory.peak, energy), memory.peak)
        return Memory(time, stress, branches, peak)

    def _stress(self, u: np.ndarray, peak: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return S (E, Q, 6) [MPa], softened, and the law's energy density W (E, Q) [MPa] at u."""
        _, lam, Vt = np.linalg.svd(self.deformation_gradient(u))
        lam = lam / np.cbrt(lam.prod(axis=-1, keepdims=True))
        energy, beta = np.empty(lam.shape[:-1]), np.empty_like(lam)
        for r, name in enumerate(self.mesh.regions):
            inside = self.mesh.region == r
            energy[inside] = self.laws[name].principal_energy(lam[inside])
            beta[inside] = self.laws[name].principal_stress(lam[inside]) @ DEVIATOR
        amount, m, share = (c[self.mesh.region][:, None] for c in self.softening.T)
        eta = 1 - amount * lost_share(energy, peak, m, share)
        principal = eta[..., None] * beta / lam**2  # of F_bar^-1 tau F_bar^-T, along the rows of Vt
        S = np.einsum("eqa,eqai,eqaj->eqij", principal, Vt, Vt, optimize=True)
        return np.ascontiguousarray(S[..., PAIRS[:, 0], PAIRS[:, 1]]), energy
