"""What a law fitted to one loading branch may leave out, as changes of the other branches, with priors and bounds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from gelforge.materials.covariates.effects import AGE, TEMPERATURE
from gelforge.mechanics.laws.softening import lost_share
from gelforge.mismatch.material.material_readings import Change, Readings
from gelforge.mismatch.material.stress_readings import Path, StressTests
from gelforge.mismatch.model.effect import Hyperparameters, Parameter

# Flow strains. Splitting is of second order (Strang 1968): the stress errs by less than 1e-3 where the flow's rate is at
# most 0.1 in a row's time (measured against steps of 1e-3).
LONGEST_STEP = 0.1
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
# A stress (n,) at the readings, and what each Maxwell element loses of it (n, k).
Losing = tuple[np.ndarray, np.ndarray]
SOFTENING = Parameter(
    "one_over_r", "1", 0.3, (0.0, 1.0), "r of 1.5 to 5 in filled rubber (Ogden & Roxburgh 1999)"
)
AGED = "elastomers lose a third or gain as much with age (ISO 188 limits)"
SIZE = Parameter("change_over_span", "1", 0.3, (-0.95, 5.0), AGED)
SHAPE = tuple(
    Parameter(f"change_of_law_shape_{j + 1}", "1", 0.3, (-2.0, 2.0), AGED) for j in range(len(LEGENDRE))
)
LOSS = Parameter(
    "change_of_relaxation", "1", 0.3, (-1.0, 5.0), "chains cut or linked by age change loss as much as stiffness"
)  # fmt: skip
UNSEEN = {
    "mullins": "no unloading or reloading: softening (mullins) cannot be seen",
    "ageing": "one date and treatment only: ageing cannot be seen",
    "temperature": "one temperature only, or none stated: its influence cannot be seen",
    "viscoelastic": "one rate, no hold and no unloading: rate dependence cannot be seen",
}


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
    thin = np.unique(np.linspace(0, len(time) - 1, min(len(time), 3000)).astype(int))
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
    return 10.0 ** np.arange(max(first, last - 8), last + 1)


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

    (_, gone), of_base = losing(np.ones_like), table["is_base"].to_numpy()
    if np.abs(gone).max() <= 1e-6 * np.abs(base).max():
        return []
    kind, first = next(iter(tests.bases.items()))
    # Of flow that stress speeds up: the strain that loads the element once, as a share of the base's range, and how fast it
    # flows at little stress, as a share of the base's rate: a steady ramp's stress is asinh(1 / share) of those strains.
    grid = np.meshgrid((0.02, 0.05, 0.1, 0.2), (1e-2, 1e-4, 1e-6, 1e-8), indexing="ij")
    shares, slow = (a.ravel() for a in grid)
    rates = slow * first.rate_per_s / (shares * tests.reach(kind))
    held = []
    for p in tests.paths:
        strains = shares * tests.reach(p.test.test)
        largest = np.abs(base[of_base & (table["test"] == p.test.test).to_numpy()]).max()
        held.append(largest * shares * p.reduced(flow(p.time_s, p.strain, p.started_s, strains, rates)))
    flows = [
        {"flow_strain": float(share * tests.reach(kind)), "flow_rate_per_s": float(rate)}
        for share, rate in zip(shares, rates)
    ]
    shapes = [losing(polynomial) for polynomial in LEGENDRE]
    return relaxations(base, of_base, gone, times, shapes, np.vstack(held), flows)


def relaxations(
    base: np.ndarray,
    of_base: np.ndarray,
    gone: np.ndarray,
    times: np.ndarray,
    shapes: Sequence[Losing] = (),
    held: np.ndarray | None = None,
    flows: Sequence[Hyperparameters] = (),
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
    mean = base[of_base] @ np.column_stack([gone, -held])[of_base] / (base[of_base] @ base[of_base])
    change = mean * base[:, None] - np.column_stack([gone, -held])
    rho = np.where(np.arange(len(mean)) < len(times), mean, 0.0)
    shapes = [(phi, np.column_stack([L, np.zeros_like(held)])) for phi, L in shapes]
    law = [Parameter(f"law_shape_{j + 1}", "1", 0.3, (-2.0, 2.0), OTHER_SHAPE) for j in range(len(shapes))]

    def relaxing(
        parameters: Sequence[Parameter], spread: np.ndarray, hyperparameters: Hyperparameters
    ) -> Change:
        def apply(P, a):
            elements = spread @ a[: len(parameters)]
            share = elements / (1 + elements @ rho)
            more = sum(c * (phi - L @ share) for c, (phi, L) in zip(a[len(parameters) :], shapes))
            return P + change @ elements + more

        return Change("viscoelastic", (*parameters, *law), apply, hyperparameters)

    return [relaxing(*choice) for choice in _choices(times, flows)]


def _choices(
    times: np.ndarray, flows: Sequence[Hyperparameters]
) -> Iterator[tuple[tuple[Parameter, ...], np.ndarray, Hyperparameters]]:
    """Yield values, which elements they are of (k + f, q), and hyperparameters.

    One element, all decades alike (stress falls with the logarithm of time), a free spectrum, one element of flow, alone or
    with all decades.
    """
    k, unit = len(times), np.eye(len(times) + len(flows))
    decades = unit[:, :k].sum(axis=1)
    even: Hyperparameters = {
        "spectrum": "all decades alike",
        "from_s": float(times[0]),
        "to_s": float(times[-1]),
    }
    yield from (((ONE,), unit[:, [i]], {"time_s": float(t)}) for i, t in enumerate(times))
    yield (DECADE,), decades[:, None], even
    by_time = tuple(Parameter(f"share_{t:.3g}s", "1", 0.2, (0.0, 5.0), PER_DECADE) for t in times)
    yield by_time, unit[:, :k], {"spectrum": "free"}
    for i, hyperparameters in enumerate(flows, start=k):
        yield (FLOW,), unit[:, [i]], hyperparameters
        yield (FLOW, DECADE), np.column_stack([unit[:, i], decades]), {**hyperparameters, **even}


def relaxation_times(tests: StressTests) -> np.ndarray:
    """Return one relaxation time per decade (k,) [s], from a tenth of the fastest loading to the longest test."""
    table = tests.readings.table
    # a loading with holds in it is as fast as its parts
    loads = table[table["is_base"]].groupby("segment")["time_s"]
    spans = (loads.max() - loads.min())[loads.size() > 1]
    longest = max(p.time_s[-1] - p.started_s for p in tests.paths)
    return decades(max(float(spans.median()), 1e-6), longest)


def of_stress(tests: StressTests) -> Readings:
    """Return the stress tests with every effect at its hyperparameters that changes them at all, and which cannot be seen.

    Gain, zero of force and zero of strain of single tests are no effects: they cannot be distinguished from samples
    that differ, and are errors of the readings.
    """
    changes = (*viscoelastic(tests), *mullins(tests), *dated(tests), *temperature(tests))
    names = {change.name for change in changes}
    unseen = (text for name, text in UNSEEN.items() if name not in names)
    return tests.readings.changed_by(changes, *unseen)


def mullins(tests: StressTests) -> list[Change]:
    """Return softening below the largest strain energy so far, r free and m, beta scanned."""
    most: dict[str, float] = {}
    energies = {}  # by path: now, and the largest so far
    for path in sorted(tests.paths, key=lambda p: p.test.cycle or 1):
        of_base = _energy(path)
        furthest = np.maximum.accumulate(np.maximum(of_base, most.get(path.test.sample, 0.0)))
        most[path.test.sample] = float(furthest[-1])
        energies[id(path)] = path.reduced(np.column_stack([of_base, furthest]))
    W, largest = np.concatenate([energies[id(p)] for p in tests.paths]).T
    moving = tests.readings.table["branch"].to_numpy() != "hold"
    return softenings(W, largest) if ((largest > 1.05 * W) & moving).any() else []


def softenings(W: np.ndarray, largest: np.ndarray, rows: np.ndarray | float = 1.0) -> list[Change]:
    """Return Ogden and Roxburgh's softening (1999) of rows (n,) at an energy (n,) below the largest one so far (n,)."""
    top = float(largest.max())
    return [
        factor(
            "mullins", SOFTENING, -lost_share(W, largest, m * top, beta) * rows,
            {"m_of_largest_energy": m, "beta": beta},
        )
        for m, beta in ((0.03, 0.1), (0.1, 0.1), (0.3, 0.1), (0.1, 0.5), (1.0, 0.1))
    ]  # fmt: skip


def _energy(path: Path) -> np.ndarray:
    """Return the base law's strain energy (m,) [MPa] at each row."""
    order = np.argsort(path.strain, kind="stable")
    e, P = np.r_[0.0, path.strain[order]], np.r_[0.0, path.stress[order]]
    energy = np.empty_like(path.strain)
    energy[order] = np.maximum(np.cumsum(np.diff(e) * (P[1:] + P[:-1]) / 2), 0.0)
    return energy


def dated(tests: StressTests) -> list[Change]:
    r"""Return ageing, linear in the date or the treatment: of the law's size, of its shape, and of how much relaxes.

    .. math:: P' = [1 + x (a_0 + \sum_j a_j L_j(s))] [P + r x (P - P_0)]

    x: share of the span; s: share of the base's range of strain; L: Legendre's polynomials; P_0: the base law. A network
    that age cuts and links anew, or a foam whose cells give in, has another law and not the old one times a factor.
    """
    base, changes = tests.readings.base, []
    s = np.clip(tests.readings.table["share"].to_numpy(), 0.0, 1.0)
    bent = np.column_stack([np.ones_like(s), *(polynomial(s) for polynomial in LEGENDRE)])
    laws = {"size": (SIZE,), "size and shape": (SIZE, *SHAPE)}
    for attribute, negligible, unit in (("age_days", AGE.alike, "days"), ("dose", 0.0, "doses")):
        x, span = _circumstance(tests, attribute, negligible)
        for what, law in laws.items() if span else ():

            def apply(P, a, x=x, law=law):
                q = len(law)
                P = P + a[q] * x * (P - base)
                return P * (1 + x * (bent[:, :q] @ a[:q]))

            of = f"{what} of the constitutive model and relaxation"
            hyperparameters = {"from": span[0], "to": span[1], "per": unit, "of": of}
            changes.append(Change("ageing", (*law, LOSS), apply, hyperparameters))
    return changes


def temperature(tests: StressTests) -> list[Change]:
    """Return the influence of the temperature: the whole stress of a test by a factor, linear in kelvin."""
    x, span = _circumstance(tests, "temperature_C", TEMPERATURE.alike)
    if span is None:
        return []
    source = "0.3 % per kelvin of an ideal rubber, some per cent of an adhesive"
    change = Parameter("change_over_span", "1", 0.01 * abs(span[1] - span[0]), (-0.95, 5.0), source)
    return [factor("temperature", change, x, {"from_C": span[0], "to_C": span[1]})]


def factor(name: str, parameter: Parameter, share: np.ndarray, hyperparameters) -> Change:
    """Return a change in proportion, by a share (n,) per unit of the parameter."""
    return Change(name, (parameter,), lambda P, a: P * (1 + share * a[0]), hyperparameters)


def _circumstance(tests: StressTests, attribute: str, negligible: float):
    """Return the circumstance of each reading (n,), 0 at the base and 1 a span away, and the span; None if all alike."""
    values = [getattr(p.test, attribute) for p in tests.paths]
    known = [v for v in values if v is not None]
    if not known or np.ptp(known) <= negligible:
        return np.zeros(0), None
    of_bases = [getattr(t, attribute) for t in tests.bases.values()]
    base = next((v for v in of_bases if v is not None), known[0])
    far = max(known, key=lambda v: abs(v - base))
    x = np.array([0.0 if v is None else (v - base) / (far - base) for v in values])
    return x[tests.readings.table["path"].to_numpy()], (float(base), float(far))
