"""Evidence of sets of effects by their linear changes of the readings: many small sets at once.

With r the whitened residual and Z the whitened columns in units of the values' plausible widths, all that a set needs are
its own rows of Z'r and its own block of Z'Z: these are computed once, and a set costs the algebra of a few values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import evidences
from gelforge.mismatch.evidence.screen import Candidate, whitened
from gelforge.mismatch.thresholds import OBSERVABLE_SNR, SCALES


@dataclass(frozen=True, eq=False)
class Linear:
    """Candidates against a residual, whitened."""

    candidates: Sequence[Candidate]
    owner: np.ndarray  # (P,) number of the candidate of each whitened column, in units of plausible values
    projected: np.ndarray  # (P,) columns' r
    gram: np.ndarray  # (P, P)
    signs: np.ndarray  # (P,) 1, -1 or 0
    binary: np.ndarray  # (C,) bool

    @classmethod
    def of(cls, residual: np.ndarray, covariance: Covariance, candidates: Sequence[Candidate]) -> Linear:
        """Return the candidates against a residual (n,)."""
        white = whitened(covariance, candidates)
        prior_sd = [
            np.ones(w.shape[1]) if c.binary else np.broadcast_to(c.prior_sd, w.shape[1])
            for c, w in zip(candidates, white)
        ]
        columns = np.column_stack([w * width for w, width in zip(white, prior_sd)])
        owner = np.repeat(np.arange(len(candidates)), [w.shape[1] for w in white])
        signs = np.concatenate([np.broadcast_to(c.signs, w.shape[1]) for c, w in zip(candidates, white)])
        return cls(
            candidates,
            owner,
            columns.T @ covariance.whiten(residual),
            columns.T @ columns,
            signs,
            np.array([c.binary for c in candidates]),
        )

    @cached_property
    def first(self) -> np.ndarray:
        """Return the first column (C,) of each candidate."""
        return np.searchsorted(self.owner, np.arange(len(self.candidates)))

    @cached_property
    def count(self) -> np.ndarray:
        """Return how many columns (C,) each candidate has."""
        return np.bincount(self.owner, minlength=len(self.candidates))

    @cached_property
    def choices(self) -> tuple[np.ndarray, np.ndarray]:
        """Return candidate (K,) and scale (K,) of all choices that the readings show: one per scale, of a switch one."""
        squares = np.bincount(self.owner, np.diag(self.gram), len(self.candidates))
        scales = [(1.0,) if on else SCALES for on in self.binary]
        number = np.repeat(np.arange(len(scales)), [len(of_one) for of_one in scales])
        shown = (np.sqrt(squares) > OBSERVABLE_SNR)[number]
        return number[shown], np.concatenate(scales)[shown]

    def log_bayes_factors(self, sets: np.ndarray, scales: np.ndarray) -> np.ndarray:
        """Return the log evidence (m,) against none of sets (m, k) of candidates at scales (m, k), 1 for switches."""
        factors = np.empty(len(sets))
        kinds = np.stack([self.count[sets], self.binary[sets]], axis=-1).reshape(len(sets), -1)
        for kind in np.unique(kinds, axis=0):
            rows = np.flatnonzero((kinds == kind).all(axis=1))
            for part in np.array_split(rows, max(1, len(rows) // 20_000)):
                factors[part] = self._of_one_kind(sets[part], scales[part])
        return factors

    def _of_one_kind(self, sets: np.ndarray, scales: np.ndarray) -> np.ndarray:
        """Return the same of sets whose candidates have, place by place, as many columns."""
        on = self.binary[sets[0]]
        free = [self._columns_of(sets[:, k]) for k in np.flatnonzero(~on)]
        factor, b = np.zeros(len(sets)), None
        fixed = [self._columns_of(sets[:, k]) for k in np.flatnonzero(on)]
        if fixed:
            at = np.hstack(fixed)
            G = self.gram[at[:, :, None], at[:, None, :]].sum(axis=(1, 2))
            factor += self.projected[at].sum(axis=1) - 0.5 * G
        if not free:
            return factor
        at = np.hstack(free)
        scale = np.hstack(
            [np.repeat(scales[:, [k]], f.shape[1], axis=1) for k, f in zip(np.flatnonzero(~on), free)]
        )
        b = self.projected[at]
        if fixed:
            b = b - self.gram[at[:, :, None], np.hstack(fixed)[:, None, :]].sum(axis=2)
        gram = scale[:, :, None] * self.gram[at[:, :, None], at[:, None, :]] * scale[:, None, :]
        return factor + evidences(scale * b, gram, self.signs[at])[0]

    def _columns_of(self, candidates: np.ndarray) -> np.ndarray:
        """Return the columns (m, p) of candidates (m,) that have as many each."""
        return self.first[candidates][:, None] + np.arange(self.count[candidates[0]])
