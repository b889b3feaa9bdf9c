r"""The contact point of an indentation: where the force begins to follow the travel, with a 95 % interval.

.. math:: F(s) = F_0 + k \, \max(s - s_0, 0)^n

on the loading ramp, every s_0 and n tried, F_0 and k by least squares. The interval holds every s_0 whose sum of squares is
within the F test's 95 % of the least, the noise's correlation counted. A power of depth is a model, the better the less
deep: the lower half and quarter of the ramp take the place of the whole where they are precise or deny it, and what they
disagree by is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as f_law

from gelforge.recording.plausibility.bends import thinned

EXPONENTS = np.arange(0.8, 2.61, 0.1)

# Intervals hold the contact points of SYNTHETIC logs, noisy and relaxing ones too (tests/importing/test_presses.py):
PLACES = 81  # that are tried, then twice as many within the neighbourhood of the least
# Of the depth that are fitted, in turn. Halves, as the error of a power law of depth falls with the depth that is
# fitted: relaxing contacts are held to 0.02 mm (tests/importing/test_presses.py).
SHARES = (1.0, 0.5, 0.25)
# Half an interval that is precise: contact points are held to 0.02 mm (tests/importing/test_presses.py).
GOOD_MM = 0.01
# Encoders, and relaxation while loading. The least band in which a stage is at rest is 0.003 mm
# (`stage_motion.LEAST_BAND_MM`): intervals then hold the contact points of tests/importing/test_presses.py.
LEAST_MODEL_MM = 0.004
# Of the depth, and at least so many mm: travel before contact that shows the force at rest. As long a rest as half of
# the ramp makes F_0 as well known as k; contact points of shallow ramps are held (tests/importing/test_presses.py).
BEFORE, LEAST_BEFORE_MM = 0.6, 0.3


@dataclass(frozen=True)
class Contact:
    """Travel at contact [mm] with its 95 % interval, and the law that was fitted: rest [N], k [N/mm^n], n."""

    travel_mm: float
    low_mm: float
    high_mm: float
    rest_N: float
    scale: float
    exponent: float

    @property
    def sd_mm(self) -> float:
        return (self.high_mm - self.low_mm) / 3.92


def contact_point(travel: np.ndarray, push: np.ndarray, first_guess_mm: float) -> Contact | None:
    """Return the contact point of a loading ramp: travel (n,) [mm] and force towards the gel (n,) [N]; None: not found.

    first_guess_mm: where the force exceeds its noise.
    """
    depth = travel.max() - first_guess_mm
    if depth <= 0:
        return None
    start = first_guess_mm - max(BEFORE * depth, LEAST_BEFORE_MM)
    chosen, model_mm = None, 0.0
    for share in SHARES:
        fit = _fit(travel, push, start, first_guess_mm + share * depth, first_guess_mm, depth)
        if fit is None:
            break
        if chosen is None:
            chosen = fit
            continue
        disagree = abs(fit.travel_mm - chosen.travel_mm)
        if fit.high_mm - fit.low_mm <= 2 * GOOD_MM or not fit.low_mm <= chosen.travel_mm <= fit.high_mm:
            chosen, model_mm = fit, disagree
        else:
            model_mm = max(model_mm, 0.5 * disagree)
    if chosen is None:
        return None
    model_mm = max(model_mm, LEAST_MODEL_MM)
    low = chosen.travel_mm - float(np.hypot(chosen.travel_mm - chosen.low_mm, model_mm))
    high = chosen.travel_mm + float(np.hypot(chosen.high_mm - chosen.travel_mm, model_mm))
    return replace(chosen, low_mm=low, high_mm=high)


def _fit(travel, push, start, end, guess, depth) -> Contact | None:
    keep = (travel >= start) & (travel <= end)
    s, f = thinned(travel[keep]), thinned(push[keep])
    if len(s) < 8:
        return None
    places = np.linspace(max(guess - 0.5 * depth - 0.1, s.min()), min(guess + 0.2 * depth, s.max()), PLACES)
    left, rest, scale = _sums(s, f, places)
    for _ in range(2):  # twice finer around the least
        step = places[1] - places[0]
        near = places[left.min(axis=1) <= left.min() * (1 + 30 / len(s))]
        places = np.linspace(near.min() - step, near.max() + step, PLACES)
        left, rest, scale = _sums(s, f, places)
    profile = left.min(axis=1)
    i = int(profile.argmin())
    j = int(left[i].argmin())
    model = rest[i, j] + scale[i, j] * np.maximum(s - places[i], 0) ** EXPONENTS[j]
    noise = f - model
    free = max(len(s) - 4, 1)
    # F's 95 %: the noise is estimated from the few samples themselves
    within = profile - profile[i] <= f_law.ppf(0.95, 1, free) * _inflation(noise) * profile[i] / free
    inside = places[within]
    return Contact(float(places[i]), float(inside.min()), float(inside.max()), float(rest[i, j]), float(scale[i, j]),
                   float(EXPONENTS[j]))  # fmt: skip


def _sums(s, f, places) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sums of squares, rests and scales (places, exponents); a scale below 0 counts as none."""
    beyond = np.maximum(s[None, :] - places[:, None], 0.0)  # (P, n)
    with np.errstate(divide="ignore"):
        log = np.log(beyond)
    left, rest, scale = (np.empty((len(places), len(EXPONENTS))) for _ in range(3))
    mean, centred = f.mean(), f - f.mean()
    for j, exponent in enumerate(EXPONENTS):
        x = np.exp(exponent * log)
        x_mean = x.mean(axis=1)
        xx = np.maximum((x**2).sum(axis=1) - len(s) * x_mean**2, 1e-300)
        k = np.maximum(x @ centred, 0.0) / xx
        left[:, j] = centred @ centred - k**2 * xx
        rest[:, j], scale[:, j] = mean - k * x_mean, k
    return np.maximum(left, 1e-300), rest, scale


def _inflation(noise: np.ndarray) -> float:
    """Return by how much neighbours that err together reduce the number of independent samples (first lags only)."""
    noise = noise - noise.mean()
    size = noise @ noise
    if size <= 0:
        return 1.0
    total = 1.0
    for lag in range(1, min(30, len(noise) - 1)):
        r = float(noise[lag:] @ noise[:-lag] / size)
        if r <= 0.05:
            break
        total += 2 * r
    return total
