"""What rate, age and temperature do to a material: effect size, interval, and the sentence a paper writes.

Each test is reduced to one number, the level: the logarithm of its nominal stress, averaged over the stretches
that all tests of the comparison reached. Differences of levels are relative differences of stress, whatever the
shape of the curves. A straight line through the levels (over log10 of the rate, over days, over kelvin) gives the
effect, and Student's t its interval. The scatter between samples is that of the residuals, or is given from
repeats (`scatter_between`). Two tests alone give no interval; then it is said which scatter between samples would
explain the change by chance, and only a change that needs more than UNLIKELY_SCATTER is called significant.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np
from scipy import stats

from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.statistics import CONFIDENCE

# Known effects are found and named (tests/materials/test_measured_effects.py):
# of ln stress between both ends of the comparison: the curves differ in shape, not by a factor
NOTABLE_TURN = 0.1
NEGLIGIBLE = 0.05  # relative change of stress over the tested span; samples of one sheet scatter by as much
UNLIKELY_SCATTER = 2 * NEGLIGIBLE  # of samples made in the same way: what needs more is no chance
LOW_STRAIN_SHARE = 0.2  # of the common range: there the stress is small and its offset counts


@dataclass(frozen=True)
class Circumstance:
    """A number that a test was made at; values closer than `alike` (of its scale) count as the same."""

    effect: str
    attribute: str  # of a test
    word: str
    unit: str
    per: str  # what a slope is per
    alike: float
    scale: Callable = np.positive  # over which the effect is a straight line

    def of(self, test: MaterialTest) -> float:
        """Return the value of a test. Raises ValueError where it is not known."""
        value = getattr(test, self.attribute)
        if value is None:
            raise ValueError(f"{test.source} {test.sample}: {self.attribute} is not known; state it")
        return float(value)


# rates within a factor of 1.4 are alike: 0.15 of log10
RATE = Circumstance(
    "strain_rate", "rate_per_s", "strain rate", "1/s", "decade of strain rate", 0.15, np.log10
)
AGE = Circumstance("age", "age_days", "age", "days", "day", 0.9)
TEMPERATURE = Circumstance("temperature", "temperature_C", "temperature", "degC", "kelvin", 1.5)
TREATMENT = Circumstance("treatment", "dose", "treatment", "doses", "dose", 1e-9)
CIRCUMSTANCES = (RATE, AGE, TEMPERATURE, TREATMENT)


@dataclass(frozen=True)
class Effect:
    """The relative change of a stress over the tested span of a circumstance, with its 95 % interval."""

    circumstance: Circumstance
    span: tuple[float, float]
    change: float  # stress at the span's end over that at its begin, less 1
    interval: tuple[float, float] | None  # of the change; None where scatter is unknown
    slope: float  # relative change of stress per decade, day or kelvin
    slope_interval: tuple[float, float] | None
    tests: int
    stretch: tuple[float, float]  # where the curves were compared
    scatter_to_explain: float  # standard deviation of samples at which the change could be chance (1 in 20)
    abscissa: str = "stretch"
    quantity: str = "nominal stress"
    at_ends: tuple[float, float] | None = None  # the change at the comparison's small and large strain

    @property
    def verdict(self) -> str:
        """Return "negligible", "significant stiffening", "significant softening", "small" or "undecided".

        negligible: the whole interval within +-5 %; significant: the interval leaves out 0 and the change exceeds
        5 %; small: it leaves out 0 but the change does not exceed 5 %; undecided: the data do not decide. Without an
        interval only what samples that scatter by UNLIKELY_SCATTER could not show by chance is significant.
        """
        if self.interval is None:
            return "undecided" if self.scatter_to_explain <= UNLIKELY_SCATTER else self._significant
        low, high = self.interval
        if -NEGLIGIBLE <= low and high <= NEGLIGIBLE:
            return "negligible"
        if low <= 0 <= high:
            return "undecided"
        if abs(self.change) <= NEGLIGIBLE:
            return "small"
        return self._significant

    @property
    def _significant(self) -> str:
        if self.quantity != "nominal stress":
            return "significant rise" if self.change > 0 else "significant fall"
        return "significant stiffening" if self.change > 0 else "significant softening"

    @property
    def sentence(self) -> str:
        """Return the finding as a paper writes it, with its numbers and threshold."""
        begin, end = self.span
        low, high = self.stretch
        where = f"at {self.abscissa} {low:.3g}"
        if high > low:
            where = f"between {self.abscissa} {low:.3g} and {high:.3g}"
        numbers = f"the {self.quantity} {where} changes by {self.change:+.1%}"
        if self.interval:
            numbers += f" (95 % interval {self.interval[0]:+.1%} to {self.interval[1]:+.1%})"
        if self.at_ends and np.ptp(np.log1p(self.at_ends)) > NOTABLE_TURN:
            small, large = self.at_ends
            numbers += f" on average, by {small:+.1%} at the smallest strain and {large:+.1%} at the largest,"
        word, unit, per = self.circumstance.word, self.circumstance.unit, self.circumstance.per
        text = f"From {begin:.3g} to {end:.3g} {unit} {numbers} in {self.tests} tests, {self.slope:+.2%} per {per}"
        endings = {
            "negligible": f"the influence of {word} is negligible (within {NEGLIGIBLE:.0%})",
            "small": f"the influence of {word} is resolved but small (at most {NEGLIGIBLE:.0%})",
            "undecided": f"these tests do not decide whether {word} matters",
        }
        ending = endings.get(self.verdict, f"{self.verdict} with {word}")
        if self.interval is None:
            compared = "more" if self.verdict.startswith("significant") else "no more"
            ending += (
                f", judged without repeats: samples that scatter by {self.scatter_to_explain:.1%} could differ so much by"
                f" chance, {compared} than the {UNLIKELY_SCATTER:.0%} that samples made alike may scatter by"
            )
        return f"{text}: {ending}."


@dataclass(frozen=True)
class Scatter:
    """The standard deviation of the level between samples, and its degrees of freedom."""

    deviation: float
    freedom: int


def scatter_between(groups: list[list[MaterialTest]]) -> Scatter:
    """Return the scatter between samples, pooled over groups of repeats made under the same circumstances.

    Parameters
    ----------
    groups : list of list of MaterialTest
        Those of a single test are left out.

    Returns
    -------
    Scatter
        Standard deviation of ln of the nominal stress [-], and its degrees of freedom.

    Raises
    ------
    ValueError
        Where no group has two tests.
    """
    logarithms = [levels(group)[0] for group in groups if len(group) > 1]
    freedom = sum(len(y) - 1 for y in logarithms)
    if not freedom:
        raise ValueError("no group has two tests; scatter between samples needs repeats")
    squares = sum(float(((y - y.mean()) ** 2).sum()) for y in logarithms)
    return Scatter(float(np.sqrt(squares / freedom)), freedom)


def first_loading(test: MaterialTest) -> MaterialTest:
    """Return the rows of the first loading, up to the first unloading; holds are left out."""
    if not test.segments:
        return test
    before = takewhile(lambda segment: segment.kind != "unload", test.segments)
    rows = [row for segment in before if segment.kind == "load" for row in range(segment.start, segment.stop)]
    if not rows:
        raise ValueError(f"{test.source} {test.sample}: no loading in the test; give one that loads")
    return test.part(np.unique(rows))


def levels(tests: list[MaterialTest]) -> tuple[np.ndarray, tuple[float, float]]:
    """Return the level of each test (n,) and the range of stretch in which they are compared."""
    curves, stretch = log_stresses(tests)
    return curves.mean(axis=1), stretch


def log_stresses(tests: list[MaterialTest]) -> tuple[np.ndarray, tuple[float, float]]:
    """Return ln of the nominal stress of each test (n, 40) from small to large strain, and the range of stretch."""
    kinds = {test.test for test in tests}
    if len(kinds) != 1:
        raise ValueError(f"tests of kinds {sorted(kinds)} cannot be compared; give those of one kind")
    curves = [first_loading(test) for test in tests]
    away = np.sign(curves[0].stretch[-1] - curves[0].at_rest)
    strain = [away * (c.stretch - c.at_rest) for c in curves]
    low, high = max(s.min() for s in strain), min(s.max() for s in strain)
    low = max(low, LOW_STRAIN_SHARE * high)
    if not high > low > 0:
        raise ValueError("the tests share no range of strain; compare tests that do")
    grid = np.linspace(low, high, 40)
    values = []
    for test, s, curve in zip(tests, strain, curves):
        order = np.argsort(s, kind="stable")
        stress = away * np.interp(grid, s[order], curve.nominal_stress[order])
        if (stress <= 0).any():
            raise ValueError(
                f"{test.source} {test.sample}: the loading stress is not above 0 at strain"
                f" {grid[np.argmax(stress <= 0)]:.3g}; correct the offset of the force"
            )
        values.append(np.log(stress))
    rest = curves[0].at_rest
    ends = float(rest + away * low), float(rest + away * high)
    return np.array(values), (min(ends), max(ends))


def effect_of(
    circumstance: Circumstance, tests: list[MaterialTest], scatter: Scatter | None = None
) -> Effect:
    """Return the effect of a circumstance on the first loading of tests."""
    values = np.array([circumstance.of(test) for test in tests])
    if len(tests) < 2 or np.ptp(values) == 0:
        raise ValueError(
            f"{len(tests)} tests with {circumstance.word} {values.tolist()}; two values that differ are needed"
        )
    curves, stretch = log_stresses(tests)
    effect = line_effect(circumstance, values, curves.mean(axis=1), stretch, tests[0].abscissa, scatter)
    x = circumstance.scale(values)
    slopes = np.polyfit(x, curves[:, [0, -1]], 1)[0]
    lower, upper = np.expm1(slopes * np.ptp(x))
    return replace(effect, at_ends=(float(lower), float(upper)))


def line_effect(
    circumstance: Circumstance,
    values: np.ndarray,
    y: np.ndarray,
    stretch: tuple[float, float],
    abscissa: str,
    scatter: Scatter | None = None,
    quantity: str = "nominal stress",
) -> Effect:
    """Return the effect from the logarithm y (n,) of a quantity at values (n,) of a circumstance."""
    x = circumstance.scale(values)
    design = np.column_stack([np.ones(len(x)), x - x.mean()])
    beta, *_ = np.linalg.lstsq(design, y, rcond=None)
    reach, spread = float(np.ptp(x)), float(np.sqrt(np.sum((x - x.mean()) ** 2)))
    freedom = len(y) - 2
    if freedom > 0 and (scatter is None or scatter.freedom <= freedom):
        residual = y - design @ beta
        scatter = Scatter(float(np.sqrt(residual @ residual / freedom)), freedom)
    slope_interval = interval = None
    if scatter is not None:
        half = stats.t.ppf(0.5 + CONFIDENCE / 2, scatter.freedom) * scatter.deviation / spread
        slope_interval = (float(np.expm1(beta[1] - half)), float(np.expm1(beta[1] + half)))
        interval = (float(np.expm1((beta[1] - half) * reach)), float(np.expm1((beta[1] + half) * reach)))
    return Effect(
        circumstance,
        (float(values.min()), float(values.max())),
        float(np.expm1(beta[1] * reach)),
        interval,
        float(np.expm1(beta[1])),
        slope_interval,
        len(y),
        stretch,
        float(abs(beta[1]) * spread / stats.norm.ppf(0.5 + CONFIDENCE / 2)),
        abscissa,
        quantity,
    )
