"""What a law fitted to one loading branch may leave out, as models of the other branches, with priors and bounds."""

from __future__ import annotations

import numpy as np
from scipy.special import erf

from gelforge.materials.covariates.circumstances import CIRCUMSTANCES
from gelforge.mismatch.material.material_evidence import Candidate
from gelforge.mismatch.material.material_readings import Path, StressTests
from gelforge.mismatch.material.material_viscosity import LEGENDRE, viscoelastic
from gelforge.mismatch.model.effect import Parameter

FAMILY_OF = {
    "viscoelastic": "history",
    "mullins": "history",
    "ageing": "history",
    "temperature": "history",
    "adhesion": "contact",
    "force_gain": "force sensor",
    "force_offset": "force sensor",
    "force_drift": "force sensor",
    "force_hysteresis": "force sensor",
    "contact_zero": "kinematics",
    "clock_offset": "kinematics",
}
MATERIAL = ("viscoelastic", "mullins", "ageing", "temperature")
WORDS = {
    "viscoelastic": "rate dependence (the material relaxes: viscoelastic)",
    "mullins": "softening below the largest strain so far (mullins)",
    "ageing": "ageing (a later date or a treatment changes the material)",
    "temperature": "temperature",
    "adhesion": "adhesion (the surface holds on to the ball)",
    "force_gain": "a gain of the force (force_gain)",
    "force_offset": "an offset of the force (force_offset)",
    "force_drift": "a drift of the force's zero (force_drift)",
    "force_hysteresis": "hysteresis of the load cell (force_hysteresis)",
    "contact_zero": "another zero of the strain or depth (contact_zero)",
    "clock_offset": "a delay between the readings (clock_offset)",
}
DECIDED_BY = {
    "viscoelastic": "hold at one strain for a hundred times the duration of the loading, and load at a tenth of its rate",
    "mullins": "load a second time, after a rest as long as ten loadings: damage stays, viscosity has recovered",
    "ageing": "load three specimens at either date: a specimen's own stiffness is then distinguished from the date",
    "temperature": "load one specimen at two temperatures, there and back",
    "adhesion": "withdraw at a tenth of the speed, and from a tenth of the push",
    "force_gain": "hang a known weight on the load cell",
    "force_offset": "read the load cell without load before and after",
    "force_drift": "read the load cell without load for as long as the test",
    "force_hysteresis": "load and unload a steel spring",
    "clock_offset": "tap once and compare the instants",
    "contact_zero": "find the touch with a preload that is read by itself",
}
ORDER = {name: k for k, name in enumerate(("viscoelastic", "adhesion", "mullins", "ageing", "temperature"))}
SENSOR = 9  # applied last
SOFTENINGS = ((0.03, 0.1), (0.1, 0.1), (0.3, 0.1), (0.1, 0.5), (1.0, 0.1))  # (m / largest energy, beta)

AGED = "elastomers lose a third or gain as much with age (ISO 188 limits)"


def stress_candidates(tests: StressTests) -> tuple[list[Candidate], list[str]]:
    """Return every effect in its shapes that changes these readings at all, and a sentence on each that cannot.

    Gain, zero of force and zero of strain of single tests are no candidates: they cannot be distinguished from samples
    that differ, and are errors of the readings.
    """
    found = [
        *viscoelastic(tests),
        *mullins(tests),
        *dated(tests),
        *temperature(tests),
    ]
    missing = {
        "mullins": "no unloading or reloading: softening (mullins) cannot be seen",
        "ageing": "one date and treatment only: ageing cannot be seen",
        "temperature": "one temperature only, or none stated: its influence cannot be seen",
        "viscoelastic": "one rate, no hold and no unloading: rate dependence cannot be seen",
    }
    names = {c.name for c in found}
    return found, [text for name, text in missing.items() if name not in names]


def mullins(tests: StressTests) -> list[Candidate]:
    """Return Ogden and Roxburgh's softening (1999) below the largest strain so far, r free and m, beta scanned."""
    most: dict[str, float] = {}
    energies: dict[int, tuple[np.ndarray, np.ndarray]] = {}  # by path: now, and the largest so far
    for path in sorted(tests.paths, key=lambda p: p.test.cycle or 1):
        own = _energy(path)
        furthest = np.maximum.accumulate(np.maximum(own, most.get(path.test.sample, 0.0)))
        most[path.test.sample] = float(furthest[-1])
        energies[id(path)] = path.reduced(own), path.reduced(furthest)
    W = np.concatenate([energies[id(p)][0] for p in tests.paths])
    Wm = np.concatenate([energies[id(p)][1] for p in tests.paths])
    moving = tests.readings.table["branch"].to_numpy() != "hold"
    if not ((Wm > 1.05 * W) & moving).any():
        return []
    inverse_r = Parameter(
        "one_over_r", "1", 0.3, (0.0, 1.0), "r of 1.5 to 5 in filled rubber (Ogden & Roxburgh 1999)", 1
    )
    top = float(Wm.max())
    return [
        Candidate(
            "mullins", (inverse_r,), _factor(-erf((Wm - W) / (m * top + beta * Wm))[:, None]), ORDER["mullins"],
            shape={"m_of_largest_energy": m, "beta": beta},
        )
        for m, beta in SOFTENINGS
    ]  # fmt: skip


def _energy(path: Path) -> np.ndarray:
    """Return the base law's strain energy (m,) [MPa] at each row."""
    order = np.argsort(path.strain, kind="stable")
    e, P = np.r_[0.0, path.strain[order]], np.r_[0.0, path.stress[order]]
    W = np.cumsum(np.r_[0.0, np.diff(e) * (P[1:] + P[:-1]) / 2])[1:]
    found = np.empty_like(W)
    found[order] = np.maximum(W, 0.0)
    return found


def dated(tests: StressTests) -> list[Candidate]:
    r"""Return ageing, linear in the date or the treatment: of the law's size, of its shape, and of how much relaxes.

    .. math:: P' = [1 + x (a_0 + \sum_j a_j L_j(s))] [P + r x (P - P_0)]

    x: share of the span; s: share of the base's range of strain; L: Legendre's polynomials; P_0: the base law. A network
    that age cuts and links anew, or a foam whose cells give in, has another law and not the old one times a factor. The
    shapes: size, or size and shape of the law, with relaxation as it was or changed too; or relaxation alone.
    """
    found, base = [], tests.readings.base
    s = np.clip(tests.readings.table["share"].to_numpy(), 0.0, 1.0)
    bent = np.column_stack([np.ones_like(s), *(polynomial(s) for polynomial in LEGENDRE)])
    size = Parameter("change_over_span", "1", 0.3, (-0.95, 5.0), AGED)
    shape = tuple(
        Parameter(f"change_of_law_shape_{j + 1}", "1", 0.3, (-2.0, 2.0), AGED) for j in range(len(LEGENDRE))
    )
    loss = Parameter(
        "change_of_relaxation", "1", 0.3, (-1.0, 5.0), "chains cut or linked by age change loss as much as stiffness"
    )  # fmt: skip
    for attribute, unit in (("age_days", "days"), ("dose", "doses")):
        x, span = _circumstance(tests, attribute, 0.0 if attribute == "dose" else CIRCUMSTANCES[1].alike)
        if x is None:
            continue
        for what, law in (("", ()), ("size", (size,)), ("size and shape", (size, *shape))):
            for relaxes in (False, True):
                if not (law or relaxes):
                    continue

                def apply(P, a, x=x, law=law, relaxes=relaxes):
                    q = len(law)
                    P = P + a[q] * x * (P - base) if relaxes else P
                    return P * (1 + x * (bent[:, :q] @ a[:q]))

                changed = " and ".join(
                    [*([f"{what} of the constitutive model"] if law else []), *(["relaxation"] * relaxes)]
                )
                span_in_words = {"from": span[0], "to": span[1], "per": unit, "of": changed}
                found.append(
                    Candidate(
                        "ageing", (*law, *((loss,) * relaxes)), apply, ORDER["ageing"], shape=span_in_words
                    )
                )
    return found


def temperature(tests: StressTests) -> list[Candidate]:
    """Return the influence of the temperature: the whole stress of a test by a factor, linear in kelvin."""
    x, span = _circumstance(tests, "temperature_C", CIRCUMSTANCES[2].alike)
    if x is None:
        return []
    width = 0.01 * abs(span[1] - span[0])
    change = Parameter(
        "change_over_span",
        "1",
        width,
        (-0.95, 5.0),
        "0.3 % per kelvin of an ideal rubber, some per cent of an adhesive",
    )
    shape = {"from_C": span[0], "to_C": span[1]}
    return [Candidate("temperature", (change,), _factor(x[:, None]), ORDER["temperature"], shape=shape)]


def _circumstance(tests: StressTests, attribute: str, alike: float):
    """Return the circumstance of each reading (n,), 0 at the base and 1 a span away, and the span; None if all alike."""
    values = [getattr(p.test, attribute) for p in tests.paths]
    known = [v for v in values if v is not None]
    if not known or np.ptp(known) <= alike:
        return None, None
    base = next(
        (getattr(t, attribute) for t in tests.base_tests.values() if getattr(t, attribute) is not None),
        known[0],
    )
    far = max(known, key=lambda v: abs(v - base))
    x = [0.0 if v is None else (v - base) / (far - base) for v in values]
    return np.array(x)[tests.readings.table["path"].to_numpy()], (float(base), float(far))


def _factor(columns: np.ndarray):
    return lambda stress, a: stress * (1 + columns @ a)
