"""Models of what material tests show besides their law, compared by evidence and by readings held out.

Readings are Gaussian about base and effects with a dense covariance (some hundred rows). An effect's model stands for
its kind: a Prony series for all viscosity, a factor for all ageing. What it may miss is allowed for as an error along each
branch of FORM_ERROR times the mismatch to be explained, the same for all effects and for none of them; without it a second
effect would be named for the misfit of the first one's formula.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pandas as pd
from scipy import stats
from scipy.linalg import cho_solve, solve_triangular
from scipy.optimize import least_squares
from scipy.special import erfcx, gammaln

from gelforge.mismatch.goodness.scan import Atoms, GlobalTest, Scan, scan
from gelforge.mismatch.model.effect import Parameter

FORM_ERROR = 0.05  # of the mismatch: what a formula with few values misses of what it stands for
FORM_LENGTH = 0.3  # of a branch, over which that error keeps its sign
AT_BOUND = 1e-3  # widths; nearer to 0 a signed value counts as absent
TAILS = 4.0  # degrees of freedom of Student's t: the errors of real tests have heavier tails than their model
EIGHTHS = 8  # of a branch, the units of a held-out score: two at least of whatever is held out
STEP = 1e-4  # widths, of the Jacobian's differences


@dataclass(frozen=True)
class Readings:
    """n reduced rows of material tests beside the base.

    fixed and shared: the covariance of measured minus a prediction f that lacks nothing is fixed + S * outer(t, t), S the
    shared errors (of sample, law, strain: shares of the stress that is there) and t = |f / base|, 1 at most. Taken of the
    measured stress instead, they would pull every fit below the readings (Peelle's puzzle; D'Agostini 1994,
    doi:10.1016/0168-9002(94)90719-6): a smaller prediction has a smaller misfit of shape, and the size is a shared error.

    table: sample, branch (load, unload, hold), segment (number, unique), progress (0..1 along it), at (stretch, shear, or
    position in mm), share (of the base's range), time_s, piece (what is held out together; "" never), words of each.
    """

    table: pd.DataFrame
    measured: np.ndarray  # (n,) nominal stress [MPa], or force [N]
    base: np.ndarray  # (n,)
    fixed: np.ndarray  # (n, n)
    noise: np.ndarray  # (n,) standard deviation of a row by the instrument alone
    law: np.ndarray  # (n,) standard deviation that the base's law brings
    zero: float  # standard deviation of the zero of stress or force
    cannot_know: tuple[str, ...] = ()
    pushed: np.ndarray | None = (
        None  # (n,) bool: between plates, which cannot pull whatever the material does
    )
    shared: np.ndarray | None = None  # (n, n); None: all errors are fixed

    def covariance_of(self, prediction: np.ndarray) -> np.ndarray:
        """Return the covariance (n, n) of measured minus a prediction (n,)."""
        if self.shared is None:
            return self.fixed
        there = np.clip(np.abs(prediction) / np.maximum(np.abs(self.base), 1e-12), 0.0, 1.0)
        return self.fixed + self.shared * np.outer(there, there)

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance (n, n) of measured minus base if nothing is missing."""
        return self.covariance_of(self.base)

    def with_form_error(self) -> Readings:
        """Return the readings with the error allowed for every formula: along one branch, over FORM_LENGTH of it."""
        segment, x = self.table["segment"].to_numpy(), self.table["progress"].to_numpy()
        near = np.exp(-np.abs(x[:, None] - x) / FORM_LENGTH)  # of all scales: a formula also misses a corner
        off, sample = self.measured - self.base, self.table["sample"].to_numpy()
        share = np.zeros(
            len(off)
        )  # of each test's stress: where effects cancel, their formulas' errors do not
        for name in np.unique(sample):
            own = sample == name
            share[own] = min(float(np.linalg.norm(off[own]) / np.linalg.norm(self.measured[own])), 1.0)
        d = FORM_ERROR * np.hypot(off, share * self.measured)
        return replace(self, fixed=self.fixed + np.outer(d, d) * near * (segment[:, None] == segment))


@dataclass(frozen=True)
class Candidate:
    """An effect in one shape: what (n,) becomes of a prediction (n,) at some values (p,); 0 is no effect.

    order: effects apply in its order, the material first and the sensor last.
    """

    name: str
    parameters: tuple[Parameter, ...]
    apply: Callable[[np.ndarray, np.ndarray], np.ndarray]
    order: int
    shape: Mapping[str, float | str] = field(default_factory=dict)


Model = tuple[Candidate, ...]


@dataclass(frozen=True)
class Fitted:
    """A model at its most probable values (p,), found on some rows; predictions and covariances are of all n rows."""

    model: Model
    amounts: np.ndarray
    amounts_covariance: np.ndarray  # (p, p), 0 for values at their bound
    prediction: np.ndarray  # (n,)
    jacobian: np.ndarray  # (n, p)
    covariance: np.ndarray  # (n, n) of measured minus prediction
    log_evidence: float  # of the rows that it was found on

    def of(self, number: int) -> slice:
        """Return where in the values those of an effect are."""
        ends = np.cumsum([0, *(len(c.parameters) for c in self.model)])
        return slice(int(ends[number]), int(ends[number + 1]))

    @property
    def directions(self) -> np.ndarray:
        """Return the Jacobian of the values that are free (n, f)."""
        return self.jacobian[:, np.diag(self.amounts_covariance) > 0]

    def change(self, number: int, readings: Readings) -> np.ndarray:
        """Return the change (n,) that an effect of the model makes, applied after those before it."""
        last = self.of(number).stop
        first, upto = self.model[:number], self.model[: number + 1]
        return predicted(readings, upto, self.amounts[:last]) - predicted(readings, first, self.amounts)


def combined(model: Model, candidate: Candidate) -> Model:
    """Return a model with one effect more, in the order in which they apply."""
    return tuple(sorted((*model, candidate), key=lambda c: c.order))


def predicted(readings: Readings, model: Model, amounts: np.ndarray) -> np.ndarray:
    """Return the prediction (n,) of a model; all of its effects act on the material before the plates let go of it."""
    stress, first = readings.base, 0
    for candidate in model:
        last = first + len(candidate.parameters)
        stress, first = candidate.apply(stress, amounts[first:last]), last
    if readings.pushed is None:
        return stress
    return np.where(readings.pushed, np.maximum(stress, np.minimum(readings.base, 0.0)), stress)


def fitted(readings: Readings, model: Model, rows: np.ndarray) -> Fitted:
    """Return a model fitted to some rows (n,) bool, with its Laplace evidence.

    Values at a bound of 0 add the half line's exact integral (Gaussian in one dimension) and take no part in the rest.
    """
    parameters = [p for c in model for p in c.parameters]
    width = np.array([p.width for p in parameters])
    low, high = np.array([_limits(p) for p in parameters]).reshape(-1, 2).T
    amounts = np.where(high <= 0, -0.1 * width, np.clip(0.1 * width, low, high) + 0.0)
    y, C = readings.measured[rows], readings.covariance
    for first in (True, False, False) if model else ():
        # first every row by its own deviation, then with the correlations that belong to the prediction so far
        L = np.diag(np.sqrt(np.diag(C)[rows])) if first else np.linalg.cholesky(C[np.ix_(rows, rows)])
        amounts = _most_probable(readings, model, rows, y, L, amounts, width, low, high)
        C = readings.covariance_of(predicted(readings, model, amounts))
    prediction = predicted(readings, model, amounts)
    L = np.linalg.cholesky(C[np.ix_(rows, rows)])
    J = _jacobian(readings, model, amounts, width, prediction)
    r, Jw = solve_triangular(L, y - prediction[rows], lower=True), solve_triangular(L, J[rows], lower=True)
    log_z = -0.5 * r @ r - np.log(np.diag(L)).sum() - 0.5 * len(y) * np.log(2 * np.pi)
    log_prior, covariance = _laplace(parameters, amounts, width, r, Jw)
    return Fitted(model, amounts, covariance, prediction, J, C, float(log_z + log_prior))


def _limits(parameter: Parameter) -> tuple[float, float]:
    low, high = parameter.bounds
    return (0.0 if parameter.sign > 0 else low), (0.0 if parameter.sign < 0 else high)


def _most_probable(readings, model, rows, y, L, start, width, low, high) -> np.ndarray:
    def residual(u):  # values in widths, so that no unit decides where the search ends
        left = y - predicted(readings, model, u * width)[rows]
        return np.concatenate([solve_triangular(L, left, lower=True, check_finite=False), u])

    inside = np.clip(start / width, low / width + 1e-6, high / width - 1e-6)
    found = least_squares(
        residual, inside, bounds=(low / width, high / width), xtol=1e-8, ftol=1e-8, gtol=1e-8, max_nfev=100
    )
    absent = (np.abs(found.x) < AT_BOUND) & ((low == 0) | (high == 0))
    return np.where(absent, 0.0, found.x * width)


def _jacobian(readings, model, amounts, width, prediction) -> np.ndarray:
    J = np.zeros((len(prediction), len(amounts)))
    for k, w in enumerate(width):
        moved = amounts.copy()
        moved[k] += STEP * w
        J[:, k] = (predicted(readings, model, moved) - prediction) / (STEP * w)
    return J


def _laplace(parameters, amounts, width, r, Jw) -> tuple[float, np.ndarray]:
    """Return log prior plus log volume of the posterior about its mode, and the covariance of the values (p, p)."""
    signed = np.array([p.sign for p in parameters], dtype=int)
    free = (signed == 0) | (amounts != 0)
    H = Jw.T @ Jw + np.diag(width**-2.0)
    log_z = -0.5 * np.sum((amounts / width) ** 2) - np.log(width).sum() - 0.5 * len(width) * np.log(2 * np.pi)
    log_z += np.log(2) * np.count_nonzero(signed)
    log_z += 0.5 * free.sum() * np.log(2 * np.pi) - 0.5 * np.linalg.slogdet(H[np.ix_(free, free)])[1]
    slope = np.maximum(-(Jw.T @ r) * signed, 0.0)
    for k in np.flatnonzero(~free):  # int_0^inf exp(-g a - h a^2 / 2) da
        h = H[k, k]
        log_z += np.log(np.sqrt(np.pi / (2 * h)) * erfcx(slope[k] / np.sqrt(2 * h)))
    covariance = np.zeros_like(H)
    covariance[np.ix_(free, free)] = np.linalg.inv(H[np.ix_(free, free)])
    return float(log_z), covariance


def held_out_scores(readings: Readings, fit: Fitted, train: np.ndarray) -> np.ndarray:
    """Return log predictive densities (k,) of the rows that are not of training (n,) bool, in units of EIGHTHS of branches.

    Each unit is predicted from the training rows alone: what is common to a sample held out (its zero, its factor) is not
    learned from its other units, before and after alike. The density is Student's with TAILS degrees: a Gaussian's score far
    outside its errors is the square of the worst unit.
    """
    held = np.flatnonzero(~train)
    table = readings.table.iloc[held]
    eighth = np.minimum((EIGHTHS * table["progress"]).astype(int), EIGHTHS - 1)
    unit = pd.factorize(table["segment"].astype(str) + "/" + eighth.astype(str))[0]
    C = fit.covariance
    C_tt = np.linalg.cholesky(C[np.ix_(train, train)])
    r = readings.measured - fit.prediction
    gain = cho_solve((C_tt, True), C[np.ix_(train, held)])  # (t, h)
    B = fit.jacobian[held] - gain.T @ fit.jacobian[train]
    S = C[np.ix_(held, held)] - C[np.ix_(held, train)] @ gain + B @ fit.amounts_covariance @ B.T
    left = r[held] - gain.T @ r[train]
    return np.array(
        [_log_student(left[unit == k], S[np.ix_(unit == k, unit == k)]) for k in range(unit.max() + 1)]
    )


def _log_student(r: np.ndarray, S: np.ndarray) -> float:
    """Return the log density of a multivariate Student's t with TAILS degrees and scale S (n, n) at r (n,)."""
    n, L = len(r), np.linalg.cholesky((S + S.T) / 2)
    z = solve_triangular(L, r, lower=True)
    scale = gammaln((TAILS + n) / 2) - gammaln(TAILS / 2) - n / 2 * np.log(TAILS * np.pi)
    return float(scale - np.log(np.diag(L)).sum() - (TAILS + n) / 2 * np.log1p(z @ z / TAILS))


def what_remains(
    readings: Readings, fit: Fitted, atoms: Atoms, rng: np.random.Generator, draws: int
) -> tuple[GlobalTest, Scan]:
    """Return the global test of what a fit leaves, and the scan over atoms of n entries; fitted directions taken out."""
    L = np.linalg.cholesky(fit.covariance)
    r = solve_triangular(L, readings.measured - fit.prediction, lower=True)
    Q = np.linalg.qr(solve_triangular(L, fit.directions, lower=True))[0]
    values = solve_triangular(L, atoms.values, lower=True)
    left = replace(atoms, values=values - Q @ (Q.T @ values))
    chi2, degrees = float(r @ r), len(r) - Q.shape[1]
    return GlobalTest(chi2, degrees, float(stats.chi2.sf(chi2, degrees))), scan(
        r - Q @ (Q.T @ r), left, rng, draws
    )


def signal_to_noise(readings: Readings, change: np.ndarray) -> float:
    """Return sqrt(d' C^-1 d) of a change d (n,) of the readings."""
    return float(
        np.linalg.norm(solve_triangular(np.linalg.cholesky(readings.covariance), change, lower=True))
    )


def cosine(readings: Readings, one: np.ndarray, two: np.ndarray) -> float:
    """Return the cosine between two whitened changes (n,); 0 where one of them is none."""
    L = np.linalg.cholesky(readings.covariance)
    a, b = (solve_triangular(L, d, lower=True) for d in (one, two))
    norm = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / norm) if norm > 0 else 0.0
