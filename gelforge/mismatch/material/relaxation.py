"""Relaxation of a material that a law fitted to its fastest loading leaves out: linear, and flow that stress speeds up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gelforge.mismatch.material.material_readings import Change
from gelforge.mismatch.material.stress_readings import StressTests
from gelforge.mismatch.model.effect import Parameter, Shape

MOST_DECADES = 9
LONGEST_PATH = 3000  # rows of one test that the hereditary integral walks along
LONGEST_STEP = 0.1  # flow strains: Strang's splitting errs by less than 1e-3 of the stress
LEGENDRE = (lambda s: 2 * s - 1, lambda s: 6 * s**2 - 6 * s + 1)  # of the share of the base's range of strain
PER_DECADE = (
    "0.2 of the stress relaxes per decade where tan delta is 0.14; adhesives reach more, filled rubber less"
)
ONE = Parameter("share", "1", 0.5, (0.0, 5.0), "half of the stress relaxes in many gels; 0 is elastic")
DECADE = Parameter("share_per_decade", "1", 0.2, (0.0, 5.0), PER_DECADE)
FLOW = Parameter(
    "flow_stiffness", "1", 1.0, (0.0, 20.0), "as much as the nominal one: half of what holds flows"
)
OTHER_SHAPE = "the unrelaxed constitutive model is of another shape than the loading"
# Of flow that stress speeds up: the strain that loads the element once, as a share of the base's range, and how fast it
# flows at little stress, as a share of the base's rate: the stress of a steady ramp is asinh(1 / share) of those strains.
FLOW_STRAINS = (0.02, 0.05, 0.1, 0.2)
FLOW_RATES = (1e-2, 1e-4, 1e-6, 1e-8)
# A stress (n,) at the readings, and what each Maxwell element loses of it (n, k).
Losing = tuple[np.ndarray, np.ndarray]


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


def lost(time: np.ndarray, stress: np.ndarray, times_s: np.ndarray, started_s: float) -> np.ndarray:
    """Return P - h (m, k) of a stress (m,) along a path of any number of rows."""
    rows = np.arange(len(time))
    thin = np.unique(np.linspace(0, len(time) - 1, min(len(time), LONGEST_PATH)).astype(int))
    gone = stress[thin, None] - hereditary(time[thin], stress[thin], times_s, started_s)
    return np.column_stack([np.interp(rows, thin, column) for column in gone.T])


def flow(
    time_s: np.ndarray, strain: np.ndarray, started_s: float, flow_strain: np.ndarray, rate_per_s: np.ndarray
) -> np.ndarray:
    r"""Return the stress (m, k) along a path (m,) of k elements that were at rest when it began, in their flow stress.

    A spring, and a dashpot with the sinh of its stress (Eyring 1936, doi:10.1063/1.1749836):

    .. math:: \dot y = \dot\epsilon / \epsilon_f - r \sinh y

    flow_strain, rate_per_s (k,): :math:`\epsilon_f` and r. Strain and flow take turns (half a step of strain, the flow's
    exact solution, half a step of strain), where strain is linear between rows. Foams and filled gels load along a bent
    curve, relax with the logarithm of time, and unload as stiffly as they began to load: a linear element that softens the
    loading so much would relax as fast when it is held.
    """
    stress, state = np.empty((len(time_s), len(flow_strain))), np.zeros(len(flow_strain))
    last_t, last_e = started_s, 0.0
    for row, (t, e) in enumerate(zip(time_s, strain)):
        steps = max(1, int(np.ceil(abs(e - last_e) / (LONGEST_STEP * flow_strain.min()))))
        half, passed = (e - last_e) / flow_strain / steps / 2, rate_per_s * max(t - last_t, 0.0) / steps
        for _ in range(steps):
            y = state + half  # -ln tanh(|y| / 2) grows at rate 1
            state = half + np.sign(y) * _minus_log_tanh_half(_minus_log_tanh_half(np.abs(y)) + passed)
        stress[row], last_t, last_e = state, t, e
    return stress


def _minus_log_tanh_half(x: np.ndarray) -> np.ndarray:
    """Return -ln tanh(x / 2) of x >= 0, which is its own inverse."""
    return np.log1p(2.0 / np.expm1(np.clip(x, 1e-300, 700.0)))


def decades(shortest_s: float, longest_s: float) -> np.ndarray:
    """Return times (k,) [s], one per decade, from a tenth of the shortest duration to the longest."""
    first, last = np.floor(np.log10(shortest_s / 10)), np.ceil(np.log10(max(longest_s, shortest_s)))
    return 10.0 ** np.arange(max(first, last - MOST_DECADES + 1), last + 1)


def viscoelastic(tests: StressTests) -> list[Change]:
    """Return relaxation of stress tests, the elastic law fitted anew under it: linear, and by flow."""
    table, base = tests.readings.table, tests.readings.base
    times = relaxation_times(tests)

    def losing(factor) -> Losing:
        of_paths = [(p, p.stress * factor(p.strain / tests.reach(p.test.test))) for p in tests.paths]
        return (
            np.concatenate([p.reduced(P) for p, P in of_paths]),
            np.vstack([p.reduced(lost(p.time_s, P, times, p.started_s)) for p, P in of_paths]),
        )

    (_, gone), own = losing(np.ones_like), table["is_base"].to_numpy()
    if np.abs(gone).max() <= 1e-6 * np.abs(base).max():
        return []
    kind, first = next(iter(tests.bases.items()))
    shares, slow = (a.ravel() for a in np.meshgrid(FLOW_STRAINS, FLOW_RATES, indexing="ij"))
    rates = slow * first.rate_per_s / (shares * tests.reach(kind))
    held = []
    for p in tests.paths:
        strains = shares * tests.reach(p.test.test)
        largest = np.abs(base[own & (table["test"] == p.test.test).to_numpy()]).max()
        held.append(largest * shares * p.reduced(flow(p.time_s, p.strain, p.started_s, strains, rates)))
    flows = [
        {"flow_strain": float(share * tests.reach(kind)), "flow_rate_per_s": float(rate)}
        for share, rate in zip(shares, rates)
    ]
    shapes = [losing(polynomial) for polynomial in LEGENDRE]
    return relaxations(base, own, gone, times, shapes, np.vstack(held), flows)


def relaxations(
    base: np.ndarray,
    own: np.ndarray,
    gone: np.ndarray,
    times: np.ndarray,
    shapes: Sequence[Losing] = (),
    held: np.ndarray | None = None,
    flows: Sequence[Shape] = (),
) -> list[Change]:
    r"""Return linear relaxation and flow as quasi-linear viscoelasticity (Fung 1993, sec. 7.6), the elastic law fitted anew.

    .. math:: P = \sum_j c_j [\phi_j - \sum_i g_i (\phi_j - h_{ij})], \qquad a_i = c_0 g_i

    phi_0 is the base law, and the others are it times Legendre's polynomials over its range: what is fitted to the fastest
    loading has relaxed there already, and stays there as it was on average. An element of flow adds its stress whatever the
    law's shape.

    gone (n, k): what elements lose of the base; own (n,) bool: readings that the base was fitted to; held (n, f): what
    elements of flow hold.
    """
    held = np.zeros((len(base), 0)) if held is None else held
    # of each element: which share of the base it changes on average where that was fitted, and the change of all but that
    mean = base[own] @ np.column_stack([gone, -held])[own] / (base[own] @ base[own])
    change = mean * base[:, None] - np.column_stack([gone, -held])
    rho = np.where(np.arange(len(mean)) < len(times), mean, 0.0)
    shapes = [(phi, np.column_stack([L, np.zeros_like(held)])) for phi, L in shapes]
    law = [Parameter(f"law_shape_{j + 1}", "1", 0.3, (-2.0, 2.0), OTHER_SHAPE) for j in range(len(shapes))]

    def relaxing(parameters: Sequence[Parameter], spread: np.ndarray, shape: Shape) -> Change:
        def apply(P, a):
            elements = spread @ a[: len(parameters)]
            share = elements / (1 + elements @ rho)
            more = sum(c * (phi - L @ share) for c, (phi, L) in zip(a[len(parameters) :], shapes))
            return P + change @ elements + more

        return Change("viscoelastic", (*parameters, *law), apply, shape)

    return [relaxing(*choice) for choice in _choices(times, flows)]


def _choices(
    times: np.ndarray, flows: Sequence[Shape]
) -> Iterator[tuple[tuple[Parameter, ...], np.ndarray, Shape]]:
    """Yield values, which elements they are of (k + f, q), and shape: one element, all decades alike (stress falls with the
    logarithm of time), a free spectrum, one element of flow, alone or beside all decades.
    """
    k, unit = len(times), np.eye(len(times) + len(flows))
    decades = unit[:, :k].sum(axis=1)
    alike: Shape = {"spectrum": "all decades alike", "from_s": float(times[0]), "to_s": float(times[-1])}
    yield from (((ONE,), unit[:, [i]], {"time_s": float(t)}) for i, t in enumerate(times))
    yield (DECADE,), decades[:, None], alike
    each = tuple(Parameter(f"share_{t:.3g}s", "1", 0.2, (0.0, 5.0), PER_DECADE) for t in times)
    yield each, unit[:, :k], {"spectrum": "free"}
    for i, shape in enumerate(flows, start=k):
        yield (FLOW,), unit[:, [i]], shape
        yield (FLOW, DECADE), np.column_stack([unit[:, i], decades]), {**shape, **alike}


def relaxation_times(tests: StressTests) -> np.ndarray:
    """Return one relaxation time per decade (k,) [s], from a tenth of the fastest loading to the longest test."""
    table = tests.readings.table
    # a loading with holds in it is as fast as its parts
    loads = table[table["is_base"]].groupby("segment")["time_s"]
    spans = (loads.max() - loads.min())[loads.size() > 1]
    longest = max(p.time_s[-1] - p.started_s for p in tests.paths)
    return decades(max(float(spans.median()), 1e-6), longest)
