"""Relaxation of a material that a law fitted to its fastest loading leaves out: linear, and flow that stress speeds up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.mismatch.material.material_evidence import Candidate
from gelforge.mismatch.material.material_flow import flow
from gelforge.mismatch.material.material_readings import LARGEST_PATH, Path, StressTests
from gelforge.mismatch.model.effect import Parameter

MOST_DECADES = 9
LEGENDRE = (lambda s: 2 * s - 1, lambda s: 6 * s**2 - 6 * s + 1)  # of the share of the base's range of strain
PER_DECADE = (
    "0.2 of the stress relaxes per decade where tan delta is 0.14; adhesives reach more, filled rubber less"
)
DECADE = Parameter("share_per_decade", "1", 0.2, (0.0, 5.0), PER_DECADE, 1)
FLOW = Parameter(
    "flow_stiffness", "1", 1.0, (0.0, 20.0), "as much as the nominal one: half of what holds flows", 1
)
# Of flow that stress speeds up: the strain that loads the element once, as a share of the base's range, and how fast it
# flows at little stress, as a share of the base's rate: the stress of a steady ramp is asinh(1 / share) of those strains.
FLOW_STRAINS = (0.02, 0.05, 0.1, 0.2)
FLOW_RATES = (1e-2, 1e-4, 1e-6, 1e-8)


def hereditary(
    path_time: np.ndarray, stress: np.ndarray, times_s: np.ndarray, started_s: float
) -> np.ndarray:
    r"""Return what each Maxwell element holds (m, k) of a stress (m,) that began at started_s from nothing.

    .. math:: h_i(t) = \int e^{-(t - s)/\tau_i} dP(s)

    exactly for a stress that is linear between rows.
    """
    h = np.zeros((len(stress), len(times_s)))
    last_t, last_P, state = started_s, 0.0, np.zeros(len(times_s))
    for j, (t, P) in enumerate(zip(path_time, stress)):
        x = max(t - last_t, 0.0) / times_s
        kept = np.where(x > 1e-8, -np.expm1(-x) / np.maximum(x, 1e-8), 1.0)
        state = state * np.exp(-x) + (P - last_P) * kept
        h[j], last_t, last_P = state, t, P
    return h


@dataclass(frozen=True)
class Viscous:
    """What relaxation does to n readings, per element (k): the base law's change, and that of other shapes of the law.

    V (n, k): rho P_e - (P_e - h), which leaves the fastest loading as it was on average; rho (k,) the share lost there.
    shapes: for each further shape of the elastic law its stress (n,) and what its elements lose of it (n, k).
    """

    V: np.ndarray
    rho: np.ndarray
    shapes: tuple[tuple[np.ndarray, np.ndarray], ...]

    def stress(self, current: np.ndarray, a: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Return the stress (n,) with the elements' values a (k,) and the law's changes of shape c."""
        share = a / (1 + a @ self.rho)
        return current + self.V @ a + sum(x * (phi - lost @ share) for x, (phi, lost) in zip(c, self.shapes))

    def seen(self, base: np.ndarray) -> bool:
        """Return whether relaxation changes any reading (n,) at all."""
        return bool(np.abs(self.V).max() > 1e-6 * np.abs(base).max())

    def beside(self, column: np.ndarray) -> Viscous:
        """Return the same with one element more, which changes the readings (n,) whatever the law's shape."""
        more = lambda lost: np.column_stack([lost, np.zeros(len(column))])  # noqa: E731
        shapes = tuple((phi, more(lost)) for phi, lost in self.shapes)
        return Viscous(np.column_stack([self.V, column]), np.r_[self.rho, 0.0], shapes)


def viscoelastic(tests: StressTests) -> list[Candidate]:
    r"""Return quasi-linear viscoelasticity (Fung 1993, sec. 7.6), the elastic law fitted anew under it.

    .. math:: P = \sum_j c_j [\phi_j - \sum_i g_i (\phi_j - h_{ij})], \qquad a_i = c_0 g_i

    phi_0 is the base law, and the others are it times Legendre's polynomials over its range: what is fitted to the fastest
    loading has relaxed there already. Shapes: one element; all decades alike (stress falls with the logarithm of time); a
    free spectrum; flow that stress speeds up, alone and beside all decades.
    """
    times = relaxation_times(tests)
    base, own = tests.readings.base, tests.readings.table["is_base"].to_numpy()
    columns = np.vstack([_lost(p, p.stress, times) for p in tests.paths])
    rho = base[own] @ columns[own] / (base[own] @ base[own])
    shapes = []
    reach = {kind: float(np.abs(t.stretch - t.at_rest).max()) for kind, t in tests.base_tests.items()}
    for polynomial in LEGENDRE:
        changed = [p.stress * polynomial(p.strain / reach[p.test.test]) for p in tests.paths]
        phi = np.concatenate([p.reduced(P) for p, P in zip(tests.paths, changed)])
        shapes.append((phi, np.vstack([_lost(p, P, times) for p, P in zip(tests.paths, changed)])))
    viscous = Viscous(rho * base[:, None] - columns, rho, tuple(shapes))
    return [*viscous_candidates(viscous, times, base), *flow_candidates(tests, viscous, times, reach)]


def viscous_candidates(viscous: Viscous, times: np.ndarray, base: np.ndarray) -> list[Candidate]:
    """Return the shapes of linear relaxation: which elements, alone, all alike or free."""
    if not viscous.seen(base):
        return []
    one = Parameter("share", "1", 0.5, (0.0, 5.0), "half of the stress relaxes in many gels; 0 is elastic", 1)
    elements = tuple(Parameter(f"share_{t:.3g}s", "1", 0.2, (0.0, 5.0), PER_DECADE, 1) for t in times)
    k = len(times)
    return [
        *(_candidate(viscous, (one,), np.eye(k)[:, [i]], {"time_s": float(t)}) for i, t in enumerate(times)),
        _candidate(viscous, (DECADE,), np.ones((k, 1)), _all_decades(times)),
        _candidate(viscous, elements, np.eye(k), {"spectrum": "free"}),
    ]


def flow_candidates(
    tests: StressTests, viscous: Viscous, times: np.ndarray, reach: dict[str, float]
) -> list[Candidate]:
    """Return an element that flows the faster the higher its stress, of several strains and rates; alone or beside decades.

    Its amount is its stiffness over the base's secant. reach: strain of the base's loading by kind of test.
    """
    base, own = tests.readings.base, tests.readings.table["is_base"].to_numpy()
    if not viscous.seen(base):
        return []
    shares, slow = (a.ravel() for a in np.meshgrid(FLOW_STRAINS, FLOW_RATES, indexing="ij"))
    kind, first = next(iter(tests.base_tests.items()))
    rates = slow * first.rate_per_s / (shares * reach[kind])
    largest = {
        kind: float(np.abs(base[own & (tests.readings.table["test"] == kind)]).max()) for kind in reach
    }
    columns = np.vstack([
        largest[p.test.test] * shares
        * p.reduced(flow(p.time_s, p.strain, p.started_s, shares * reach[p.test.test], rates))
        for p in tests.paths
    ])  # fmt: skip
    columns -= np.outer(base, base[own] @ columns[own] / (base[own] @ base[own]))
    k, found = len(times), []
    alone, beside = np.eye(k + 1)[:, [k]], np.column_stack([np.eye(k + 1)[:, k], np.r_[np.ones(k), 0.0]])
    for column, share, rate in zip(columns.T, shares, rates):
        both = viscous.beside(column)
        shape = {"flow_strain": float(share * reach[kind]), "flow_rate_per_s": float(rate)}
        found += [
            _candidate(both, (FLOW,), alone, shape),
            _candidate(both, (FLOW, DECADE), beside, shape | _all_decades(times)),
        ]
    return found


def _candidate(viscous: Viscous, parameters: tuple[Parameter, ...], spread: np.ndarray, shape) -> Candidate:
    """Return a shape of relaxation; spread (k, q): which elements the q values are of."""
    q = len(parameters)
    why = "the unrelaxed constitutive model is of another shape than the loading"
    law = tuple(
        Parameter(f"law_shape_{j + 1}", "1", 0.3, (-2.0, 2.0), why) for j in range(len(viscous.shapes))
    )
    return Candidate(
        "viscoelastic", (*parameters, *law), lambda P, a: viscous.stress(P, spread @ a[:q], a[q:]), 0, shape=shape
    )  # fmt: skip


def _all_decades(times: np.ndarray) -> dict[str, float | str]:
    return {"spectrum": "all decades alike", "from_s": float(times[0]), "to_s": float(times[-1])}


def relaxation_times(tests: StressTests) -> np.ndarray:
    """Return one relaxation time per decade (k,) [s], from a tenth of the fastest loading to the longest test."""
    table = tests.readings.table
    loads = table[table["is_base"]].groupby("segment")[
        "time_s"
    ]  # a loading with holds in it is as fast as its parts
    spans = (loads.max() - loads.min())[loads.size() > 1]
    longest = max(p.time_s[-1] - p.started_s for p in tests.paths)
    return decades(max(float(spans.median()), 1e-6), longest)


def decades(shortest_s: float, longest_s: float) -> np.ndarray:
    """Return times (k,) [s], one per decade, from a tenth of the shortest duration to the longest."""
    first, last = np.floor(np.log10(shortest_s / 10)), np.ceil(np.log10(max(longest_s, shortest_s)))
    return 10.0 ** np.arange(max(first, last - MOST_DECADES + 1), last + 1)


def _lost(path: Path, stress: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return P - h of a stress (m,) along a path, reduced to readings (k, len(times))."""
    thin = np.unique(np.linspace(0, len(path.time_s) - 1, min(len(path.time_s), LARGEST_PATH)).astype(int))
    h = hereditary(path.time_s[thin], stress[thin], times, path.started_s)
    lost = (stress[thin, None] - h).T
    return path.reduced(np.column_stack([np.interp(np.arange(len(path.time_s)), thin, c) for c in lost]))
