"""What is missing or odd in a material test, in sentences; and the corrections that may be asked for.

Nothing is changed by looking: `findings` only speaks. `corrected` changes what the mapping asks for and says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.segments import TOLERANCE, largest_back_step
from gelforge.materials.basis.statistics import row_noise
from gelforge.materials.basis.stresses import neo_hookean_shape, ogden_shape
from gelforge.materials.plausibility.rest_force import REST, rest_words

# Preloads, offsets and toes are distinguished from noise (tests/materials/test_curve_defects.py):
FEW_ROWS = 20  # below, the scatter of a fit rests on too few residuals
# A first row further from rest than this was not taken at the start: one at a strain of 0.04 is reported, a clean curve has
# nothing to report (tests/materials/test_mapping.py).
STRAIN_AT_START = 0.005
# The stress extrapolates to zero this far from rest: a toe of 0.03 is reported, a clean curve has nothing to report
# (tests/materials/test_mapping.py).
TOE_STRAIN = 0.005
# Of strain above the first row: by what lies there preloads of gels with exponents of 1.3 to 3 are corrected within 1 %
# (tests/materials/test_curve_defects.py).
TOE_WINDOW = 0.25
# Exponent of an Ogden solid of one term: 1.3 of the first term of rubber (Ogden 1972), 2 of a neo-Hookean solid, 3 of a gel
# that stiffens (judgement). It keeps the curve neo-Hookean where noise hides how it bends.
EXPONENT, EXPONENT_SD = 2.0, 1.0
# Of the largest stress: a third of what load cells of class C3 resolve (OIML R 60:2021).
LEAST_NOISE = 1e-4
# Relative: a rate of 0.05 1/s in a file's name is reported where its columns give 0.2 (tests/materials/test_mapping.py).
RATE_DIFFERS = 0.1
RATE_SPREAD = 1.5  # between the slow and the fast tenth of a loading
INTERVAL_SPREAD = 3.0  # between the sampling intervals of one test
LEFT_STRESS = 5e-3  # of the largest: the drift that a load cell of half a per cent may have (ISO 7500-1:2018, class 0.5)
PRELOAD_ROWS = 3  # that wait at one stretch before the ramp
# An offset smaller than this many standard errors is noise: a clean curve has nothing to report, 2 kPa at rest are reported
# (tests/materials/test_mapping.py).
SIGMAS = 3.0


def findings(test: MaterialTest, stated_rate: float | None = None, stated_by: str = "") -> list[str]:
    """Return sentences about what is missing or odd; stated_rate [1/s] is what a name, column or person says."""
    parts = [
        few_rows(len(test.stretch)),
        _start(test),
        _toe(test),
        _rest_stress(test),
        _preload(test),
        _end_stress(test),
        _order(test),
        _back_steps(test),
        _time(test),
        _rate(test, stated_rate, stated_by),
        _history(test),
    ]
    return [sentence for part in parts for sentence in part]


def corrected(
    test: MaterialTest,
    toe: bool = False,
    zero_force: bool = False,
    zero_strain: bool = False,
    of_gauge: bool = False,
) -> MaterialTest:
    """Return the test with the corrections asked for, each stated in its findings.

    of_gauge: a strain is a way over the length of the unloaded specimen, which a zero set under load leaves as it is. Else
    the zero of the strain is the length itself.
    """
    said = []
    if zero_force and (offset := rest_stress(test)) is not None:
        said.append(f"corrected: {offset[0] * 1e3:.4g} kPa at rest subtracted (zero_force)")
        test = replace(test, nominal_stress=test.nominal_stress - offset[0])
    elif zero_force:
        said.append("zero_force was asked for, but no row is at rest; nothing was subtracted")
    if zero_strain:
        said.append(f"corrected: the first row, {test.stretch[0]:.5g}, is taken as rest (zero_strain)")
        test = replace(
            test, stretch=_moved(test.test, test.stretch, test.stretch[0] - test.at_rest, of_gauge)
        )
    if toe:
        shift = _zero_of_stress(test, of_gauge)
        if shift is None:
            said.append("toe: remove was asked for, but the loading has too few rows near its start")
        else:
            said.append(f"corrected: origin moved by {shift:.4f} to the zero of stress (toe)")
            test = replace(test, stretch=_moved(test.test, test.stretch, shift, of_gauge))
    return replace(test, findings=(*test.findings, *said))


def _zero_of_stress(test: MaterialTest, of_gauge: bool) -> float | None:
    """Return the strain of the zero of stress; None where there are too few rows.

    That of a preloaded specimen lies outside the rows, and how these bend decides where. No neo-Hookean solid bends as a gel
    that stiffens: it is found by an Ogden solid of one term.
    """
    start = zero_stress_strain(test)
    if start is None:
        return None
    lam, stress = _start_of_loading(test)
    if start[0] * (lam[-1] - lam[0]) >= 0:  # slack or a toe, which lies within the rows
        return start[0]
    noise = max(row_noise(stress), LEAST_NOISE * np.abs(stress).max())

    def errors(parameters: np.ndarray) -> np.ndarray:
        shift, log_modulus, exponent = parameters
        shape = ogden_shape(test.test, _moved(test.test, lam, shift, of_gauge), exponent)
        return np.append((np.exp(log_modulus) * shape - stress) / noise, (exponent - EXPONENT) / EXPONENT_SD)

    modulus = np.ptp(stress) / np.ptp(neo_hookean_shape(test.test, lam))
    begin, far = np.array([start[0], np.log(modulus), EXPONENT]), np.array([0.5, 3.0, 3 * EXPONENT_SD])
    fit = least_squares(errors, begin, bounds=(begin - far, begin + far), x_scale=[0.05, 0.5, 1.0])
    return float(fit.x[0])


def _start_of_loading(test: MaterialTest) -> tuple[np.ndarray, np.ndarray]:
    """Return stretches and stresses (n,) of the first loading's start; none of too few rows."""
    none = np.zeros(0), np.zeros(0)
    first = next((s for s in test.segments if s.kind == "load"), None)
    if first is None or test.test == "biaxial" or test.cauchy_difference is not None:
        return none
    lam, stress = test.stretch[first.rows], test.nominal_stress[first.rows]
    near = np.abs(lam - lam[0]) <= TOE_WINDOW
    far = abs(lam[0] - test.at_rest) > abs(lam[-1] - test.at_rest)
    return none if near.sum() < 5 or far else (lam[near], stress[near])


def rate_while_loading(test: MaterialTest) -> tuple[float, float, float] | None:
    """Return the median rate [1/s] over equal sections of the loadings, and its first and last decile."""
    if test.time_s is None:
        return None
    rates = [
        _section_rates(test.stretch[s.rows], test.time_s[s.rows]) for s in test.segments if s.kind == "load"
    ]
    if not rates or not sum(map(len, rates)):
        return None
    median, low, high = np.quantile(np.concatenate(rates), [0.5, 0.1, 0.9])
    return float(median), float(low), float(high)


def _section_rates(lam: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return the rates [1/s] over equal sections of a loading; whole sections average the noise of single rows."""
    outward = np.maximum.accumulate(np.sign(lam[-1] - lam[0]) * lam)
    first = np.r_[True, np.diff(outward) > 0]  # the envelope grows strictly
    levels = np.linspace(outward[0], outward[-1], min(10, first.sum() - 1) + 1)
    spans = np.diff(np.interp(levels, outward[first], time[first]))
    return (np.diff(levels) / np.maximum(spans, 1e-12))[spans > 0]


def zero_stress_strain(test: MaterialTest) -> tuple[float, float] | None:
    """Return the strain at which the first loading's stress extrapolates to zero, and its standard error.

    The neo-Hookean shape G (lam - lam^-2) straightens the curve of an elastomer, so that the extrapolation is
    not bent (compare the toe compensation of ASTM D638, annex A1). Below the zero the toe itself is left out.
    """
    lam, stress = _start_of_loading(test)
    if not len(lam):
        return None
    x = neo_hookean_shape(test.test, lam)
    steep = np.abs(x - x[0]) > 0.2 * np.ptp(x)  # above a toe, if there is one
    if steep.sum() < 4:
        return None
    lam, stress = lam[steep], stress[steep]
    design = np.column_stack([np.ones(len(lam)), neo_hookean_shape(test.test, lam)])
    beta, *_ = np.linalg.lstsq(design, stress, rcond=None)
    if beta[1] <= 0:
        return None
    residual = stress - design @ beta
    variance = residual @ residual / max(len(lam) - 2, 1) * np.linalg.pinv(design.T @ design)
    zero = -beta[0] / beta[1]
    gradient = np.array([-1 / beta[1], beta[0] / beta[1] ** 2])
    slope = {"uniaxial": 3, "compression": 3, "pure_shear": 4, "equibiaxial": 6, "simple_shear": 1}[test.test]
    return float(zero / slope), float(np.sqrt(gradient @ variance @ gradient) / slope)


def rest_stress(test: MaterialTest) -> tuple[float, float] | None:
    """Return the mean nominal stress [MPa] of the first rows at rest and its standard error, None without any."""
    resting = np.abs(test.stretch - test.at_rest) <= REST
    last = len(resting) if resting.all() else int(np.argmin(resting))
    if not last:
        return None
    stress = test.nominal_stress[:last]
    if last > 1:
        return float(stress.mean()), float(stress.std(ddof=1) / np.sqrt(last))
    return float(stress.mean()), row_noise(test.nominal_stress)


def _moved(test: str, stretch: np.ndarray, shift: float, of_gauge: bool) -> np.ndarray:
    """Return the stretch with its origin moved by a strain; stresses keep their values, as force and section stay."""
    if of_gauge or test == "simple_shear":
        return stretch - shift
    return stretch / (1 + shift)  # the zero was (1 + shift) times longer


def few_rows(n: int) -> list[str]:
    """Return a sentence if a test has few rows."""
    if n >= FEW_ROWS:
        return []
    return [f"only {n} rows: expect wide intervals, and no more parameters than a third of the rows"]


def _start(test):
    strain = test.stretch[0] - test.at_rest
    if _crosses_rest(test) or abs(strain) > abs(test.stretch[-1] - test.at_rest):
        return  # known by its order
    if test.history != "relaxation" and abs(strain) > STRAIN_AT_START:
        yield (
            f"the first row is at {test.stretch[0]:.5g}, not at rest ({test.at_rest:g}): slack taken up, a late"
            " start or a part of a curve (`zero_strain` moves it)"
        )


def _toe(test):
    strain = zero_stress_strain(test)
    if strain is None:
        return
    lam, _ = _start_of_loading(test)
    late = strain[0] * np.sign(lam[-1] - lam[0])  # a concave curve has it before rest: no toe
    if late > max(TOE_STRAIN, SIGMAS * strain[1]):
        yield (
            f"the stress extrapolates to zero at a strain of {strain[0]:.4f} +- {strain[1]:.4f}: toe, slack or an"
            " offset of the force (`toe: remove` moves the origin there)"
        )


def _rest_stress(test):
    at_rest = rest_stress(test) if test.cauchy_difference is None else None
    if at_rest is None:
        return
    largest = np.nanmax(np.abs(test.nominal_stress))
    if abs(at_rest[0]) > max(SIGMAS * at_rest[1], 5e-4 * largest):
        yield (
            f"{at_rest[0] * 1e3:.4g} kPa ({abs(at_rest[0]) / largest:.2%} of the largest) at rest:"
            f" {rest_words(test, at_rest[0])}"
        )


def _preload(test):
    """Say which stress a sample bears while it waits near rest: the machine took up slack, or pressed it to be flat."""
    start = test.stretch[0]
    if test.cauchy_difference is not None or not REST < abs(start - test.at_rest) <= STRAIN_AT_START:
        return  # at rest: reported as its stress there; further away: as a late start
    waits = np.abs(test.stretch - start) <= REST / 2
    count = len(waits) if waits.all() else int(np.argmin(waits))
    if count < PRELOAD_ROWS:
        return
    stress, largest = test.nominal_stress[:count], np.nanmax(np.abs(test.nominal_stress))
    mean, error = float(stress.mean()), float(stress.std(ddof=1) / np.sqrt(count))
    if abs(mean) > max(SIGMAS * error, LEFT_STRESS * largest):
        yield (
            f"{mean * 1e3:.4g} kPa ({abs(mean) / largest:.2%} of the largest) in the first {count} rows, at {start:.5g}:"
            " a preload, or an offset of the force; it is kept"
        )


def _end_stress(test):
    """Say where a stress of the other sign is left after the unloading: a body that has come free has none."""
    if not test.segments or test.segments[-1].kind != "unload" or not np.isfinite(test.nominal_stress).all():
        return
    stress = test.nominal_stress[test.segments[-1].rows]
    end, largest = float(np.median(stress[-max(len(stress) // 10, 3) :])), np.max(np.abs(test.nominal_stress))
    load = test.nominal_stress[np.argmax(np.abs(test.nominal_stress))]
    if end * load < 0 and abs(end) > LEFT_STRESS * largest:
        yield (
            f"{end * 1e3:.3g} kPa ({abs(end) / largest:.2%} of the largest) of the other sign are left after the"
            " unloading: the zero of the force drifted, the sample sticks, or it is bent back"
        )


def _order(test):
    first, last = abs(test.stretch[0] - test.at_rest), abs(test.stretch[-1] - test.at_rest)
    if test.history == "monotonic" and first > last:
        yield (
            "rows run from the largest strain back to rest: an unloading, or a table sorted by stretch;"
            " without a time it cannot be decided"
        )
    if test.history == "monotonic" and _crosses_rest(test):
        yield "the curve crosses rest: tension and compression (or both ways of shear) in one table"


def _crosses_rest(test) -> bool:
    strain = test.stretch - test.at_rest
    return bool(strain.min() < -STRAIN_AT_START and strain.max() > STRAIN_AT_START)


def _back_steps(test):
    back = largest_back_step(test.stretch) if test.history == "monotonic" else 0.0
    if 0 < back <= TOLERANCE and np.ptp(test.stretch) > 0:
        yield f"the stretch falls back by up to {back:.2%} of its range: noise of its measurement"


def _time(test):
    if test.time_s is None:
        yield "no time column: rate, holds and relaxation cannot be found"
        return
    steps = np.diff(test.time_s)
    repeated = int((steps == 0).sum())
    if repeated:
        yield f"{repeated} of {len(steps) + 1} rows repeat the time stamp of the row before (coarse clock)"
    positive = steps[steps > 0]
    if len(positive) > 10:
        slow, fast = np.quantile(positive, [0.98, 0.02])
        if slow > INTERVAL_SPREAD * fast:
            yield f"the sampling interval is between {fast:.3g} and {slow:.3g} s: the rows do not have equal weights"


def _rate(test, stated, stated_by):
    rate = rate_while_loading(test)
    if rate is None:
        if stated is not None:
            yield f"rate {stated:g} 1/s {stated_by}, not checked: there is no time or no loading"
        return
    middle, slow, fast = rate
    if stated is not None and abs(middle / stated - 1) > RATE_DIFFERS:
        yield f"rate {stated:g} 1/s {stated_by}, but the columns give {middle:.4g} 1/s; the columns are used"
    if fast > RATE_SPREAD * slow:
        yield f"the loading is not at one rate: {slow:.3g} to {fast:.3g} 1/s (median {middle:.3g})"


def _history(test):
    kinds = {segment.kind for segment in test.segments}
    if test.history == "cyclic" and "unload" not in kinds:
        yield "declared cyclic, but no unloading is found"
    if test.history == "relaxation" and "hold" not in kinds:
        yield "declared relaxation, but no hold is found"
