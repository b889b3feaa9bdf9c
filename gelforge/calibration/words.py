"""What a calibration says in sentences: which parameters the presses leave open, and what would tell two of them apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from gelforge.calibration.fit import Fit
from gelforge.mismatch.thresholds import ADEQUATE_P, INDISTINGUISHABLE

AT_PRIOR = 0.8  # of the prior's standard deviation: above it the presses have said little
REMEDIES = {
    frozenset(("modulus", "thickness")): "press near a wall or deeper, or measure the thickness",
    frozenset(("modulus", "exponent")): "press deeper, or with a smaller ball",
    frozenset(("modulus",)): "press less deep and with a smaller ball, or measure one of the moduli",
    frozenset(("modulus", "friction")): "shear the surface once it touches, or lubricate the indenter",
    frozenset(
        ("modulus", "contact_point")
    ): "press to many small depths, or find the touch by another threshold",
    frozenset(("modulus", "force_gain")): "weigh a reference load",
    frozenset(("modulus", "base.compliance")): "press a wide flat indenter, or watch the base with a gauge",
    frozenset(("thickness", "friction")): "measure the thickness, or lubricate the indenter",
}
OTHERWISE = "measure one of them, or record presses of another kind"


def kind_of(name: str) -> str:
    """Return the kind of a parameter: its name without the layer's."""
    return name if name == "base.compliance" else name.rpartition(".")[2]


def correlation(covariance: np.ndarray) -> np.ndarray:
    """Return the correlations (q, q) of a covariance."""
    sd = np.sqrt(np.diag(covariance))
    return covariance / np.outer(sd, sd)


def inseparable(names: Sequence[str], correlations: np.ndarray) -> Iterator[str]:
    """Yield a sentence for each pair of parameters that the presses cannot tell apart."""
    for i, j in combinations(range(len(names)), 2):
        if abs(correlations[i, j]) > INDISTINGUISHABLE:
            remedy = REMEDIES.get(frozenset((kind_of(names[i]), kind_of(names[j]))), OTHERWISE)
            yield (
                f"{names[i]} and {names[j]} cannot be distinguished by these presses"
                f" (correlation {correlations[i, j]:+.2f}); {remedy}."
            )


def at_bounds(fit: Fit) -> list[bool]:
    """Return which estimates lie on a physical bound."""
    close = [1e-2 * one.width for one in fit.free]
    return [bool(min(a - one.bounds[0], one.bounds[1] - a) < c) for one, a, c in zip(fit.free, fit.a, close)]


def sentences(fit: Fit) -> list[str]:
    """Return what a user must know of a calibration."""
    names = [one.name for one in fit.free]
    said = list(inseparable(names, correlation(fit.covariance)))
    left = [one.name for one, sd in zip(fit.free, fit.sd) if sd > AT_PRIOR * one.width]
    if left:
        said.append(f"The presses leave {', '.join(left)} at the prior: they hardly depend on it.")
    if bounded := [one.name for one, there in zip(fit.free, at_bounds(fit)) if there]:
        said.append(
            f"{', '.join(bounded)} on a physical bound, where its interval is that of a linear change; record presses that"
            " depend on it, or give a narrower prior."
        )
    if not fit.converged:
        said.append(f"The estimate still moved after {fit.solved} solutions; give a narrower prior.")
    if fit.p < ADEQUATE_P:
        said.append(
            f"More is left of the readings than their errors allow (p = {fit.p:.1g}), so the study leaves something out and"
            " the intervals are too narrow: `gelforge mismatch` asks what it is."
        )
    return said
