"""What a law fitted to one loading branch may leave out, as changes of the other branches, with priors and bounds."""

from __future__ import annotations

import numpy as np

from gelforge.materials.covariates.effects import AGE, TEMPERATURE
from gelforge.mechanics.laws.softening import lost_share
from gelforge.mismatch.material.material_readings import Change, Readings
from gelforge.mismatch.material.relaxation import LEGENDRE, viscoelastic
from gelforge.mismatch.material.stress_readings import Path, StressTests
from gelforge.mismatch.model.effect import Parameter

SOFTENINGS = ((0.03, 0.1), (0.1, 0.1), (0.3, 0.1), (0.1, 0.5), (1.0, 0.1))  # (m / largest energy, beta)
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


def of_stress(tests: StressTests) -> Readings:
    """Return the stress tests with every effect in its shapes that changes them at all, and which cannot be seen.

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
        own = _energy(path)
        furthest = np.maximum.accumulate(np.maximum(own, most.get(path.test.sample, 0.0)))
        most[path.test.sample] = float(furthest[-1])
        energies[id(path)] = path.reduced(np.column_stack([own, furthest]))
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
        for m, beta in SOFTENINGS
    ]  # fmt: skip


def _energy(path: Path) -> np.ndarray:
    """Return the base law's strain energy (m,) [MPa] at each row."""
    order = np.argsort(path.strain, kind="stable")
    e, P = np.r_[0.0, path.strain[order]], np.r_[0.0, path.stress[order]]
    found = np.empty_like(path.strain)
    found[order] = np.maximum(np.cumsum(np.diff(e) * (P[1:] + P[:-1]) / 2), 0.0)
    return found


def dated(tests: StressTests) -> list[Change]:
    r"""Return ageing, linear in the date or the treatment: of the law's size, of its shape, and of how much relaxes.

    .. math:: P' = [1 + x (a_0 + \sum_j a_j L_j(s))] [P + r x (P - P_0)]

    x: share of the span; s: share of the base's range of strain; L: Legendre's polynomials; P_0: the base law. A network
    that age cuts and links anew, or a foam whose cells give in, has another law and not the old one times a factor.
    """
    base, found = tests.readings.base, []
    s = np.clip(tests.readings.table["share"].to_numpy(), 0.0, 1.0)
    bent = np.column_stack([np.ones_like(s), *(polynomial(s) for polynomial in LEGENDRE)])
    laws = {"size": (SIZE,), "size and shape": (SIZE, *SHAPE)}
    for attribute, alike, unit in (("age_days", AGE.alike, "days"), ("dose", 0.0, "doses")):
        x, span = _circumstance(tests, attribute, alike)
        for what, law in laws.items() if span else ():

            def apply(P, a, x=x, law=law):
                q = len(law)
                P = P + a[q] * x * (P - base)
                return P * (1 + x * (bent[:, :q] @ a[:q]))

            of = f"{what} of the constitutive model and relaxation"
            shape = {"from": span[0], "to": span[1], "per": unit, "of": of}
            found.append(Change("ageing", (*law, LOSS), apply, shape))
    return found


def temperature(tests: StressTests) -> list[Change]:
    """Return the influence of the temperature: the whole stress of a test by a factor, linear in kelvin."""
    x, span = _circumstance(tests, "temperature_C", TEMPERATURE.alike)
    if span is None:
        return []
    source = "0.3 % per kelvin of an ideal rubber, some per cent of an adhesive"
    change = Parameter("change_over_span", "1", 0.01 * abs(span[1] - span[0]), (-0.95, 5.0), source)
    return [factor("temperature", change, x, {"from_C": span[0], "to_C": span[1]})]


def factor(name: str, parameter: Parameter, share: np.ndarray, shape) -> Change:
    """Return a change in proportion, by a share (n,) per unit of the parameter."""
    return Change(name, (parameter,), lambda P, a: P * (1 + share * a[0]), shape)


def _circumstance(tests: StressTests, attribute: str, alike: float):
    """Return the circumstance of each reading (n,), 0 at the base and 1 a span away, and the span; None if all alike."""
    values = [getattr(p.test, attribute) for p in tests.paths]
    known = [v for v in values if v is not None]
    if not known or np.ptp(known) <= alike:
        return np.zeros(0), None
    of_bases = [getattr(t, attribute) for t in tests.bases.values()]
    base = next((v for v in of_bases if v is not None), known[0])
    far = max(known, key=lambda v: abs(v - base))
    x = np.array([0.0 if v is None else (v - base) / (far - base) for v in values])
    return x[tests.readings.table["path"].to_numpy()], (float(base), float(far))
