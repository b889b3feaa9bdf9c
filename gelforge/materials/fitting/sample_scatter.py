"""Whether the samples of one material differ by more than their noise: batches, or a size that was not measured."""

from __future__ import annotations

import numpy as np

from gelforge.materials.fitting.curves import MeanCurve
from gelforge.mechanics.laws.law import PrincipalLaw

LEAST_RATIO = (
    1.1  # between the stiffest and the softest: samples of one mould scatter by 2 to 5 % about their mean
)
# The largest difference of five specimens exceeds three standard errors by chance in 2 % of cases, four in 0.06 %
# (studentized range, Tukey 1953).
SIGMAS = 4.0


def scatter(curve: MeanCurve, law: PrincipalLaw) -> list[str]:
    """Return a sentence where the samples of a curve differ by more than LEAST_RATIO and by more than their noise.

    Each sample's stress is taken as a multiple of the mean curve; what is left about that is its noise and the
    difference of its shape, which both make the multiple less certain.
    """
    stress, mean = curve.sample_nominal_stress, curve.nominal_stress
    if len(stress) < 2 or curve.component != "1":
        return []
    factors = stress @ mean / (mean @ mean)  # (s,)
    left = stress - factors[:, None] * mean
    errors = np.sqrt((left**2).sum(axis=1) / (len(mean) - 1) / (mean @ mean))
    low, high = int(np.argmin(factors)), int(np.argmax(factors))
    apart, noise = factors[high] - factors[low], np.hypot(errors[low], errors[high])
    if not 0 < factors[low] * LEAST_RATIO < factors[high] or apart < SIGMAS * noise:
        return []
    E = law.youngs_modulus * 1e3 * factors[[low, high]]
    known_to = float(np.max(errors / factors))
    return [
        f"{curve.label}: the samples differ by more than their noise: E = {E[0]:.3g} kPa ({curve.samples[low]}) to"
        f" {E[1]:.3g} kPa ({curve.samples[high]}), a factor of {factors[high] / factors[low]:.2f}, each known to"
        f" {known_to:.1%}; if they are different batches, give each a material of its own"
    ]
