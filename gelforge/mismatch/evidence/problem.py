"""What the judge works on: readings, what the base says of them, how sure both are, and how effects would change it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from gelforge.mismatch.evidence.covariance import Covariance, slowly
from gelforge.mismatch.evidence.screen import Candidate, Slope, Term, next_to, slopes
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.thresholds import PLACE_ERROR, SCATTERED, SEEN_ERROR

# Forces (R, 3) [N] at readings (R,) bool with effects at their values, nan elsewhere; raises NotConverged.
ForcesWith = Callable[[Sequence[Term], np.ndarray], np.ndarray]


def never_solved(terms: Sequence[Term], rows: np.ndarray) -> np.ndarray:
    """The `forces_with` of a problem that is judged by its columns alone."""
    raise NotImplementedError("this problem has columns only; give it forces_with to fit values")


def at_first_order(problem: Problem) -> ForcesWith:
    """Return the `forces_with` of a problem by its own linear changes."""

    def forces(terms: Sequence[Term], rows: np.ndarray) -> np.ndarray:
        shown = rows[:, None] & problem.observations.read
        return np.where(shown, problem.base + problem.linear_change(terms), np.nan)

    return forces


@dataclass(frozen=True, eq=False)
class Problem:
    """A recording next to its base. Flat vectors have n entries: what was read of R readings x 3 axes."""

    observations: Observations
    base: np.ndarray  # (R, 3) [N]
    covariance: Covariance  # of n entries
    candidates: Sequence[Candidate]  # linear changes of the n entries
    effects: Mapping[str, Effect]
    forces_with: ForcesWith
    failed: Mapping[str, str]  # effects that could not be computed, and why
    # By which a change that is solved errs, a share of it; 0: no change errs, by form neither
    change_error: float = 0.0
    boxes: Sequence[Candidate] = ()  # linear changes by the modulus of boxes of the body, for its map alone
    # kernels.Module: physics with a free form, its changes of the entries of force
    modules: Sequence[Any] = ()
    # Forces (R, 3) [N] of effects that are not solved, on the base and a change (R, 3) of it; None: not known apart.
    read_with: ForcesWith | None = None
    flow: Any = None  # flow.FlowChannel where images are judged with the forces

    @cached_property
    def labels(self) -> pd.DataFrame:
        """Return the labels of the n entries; not to be changed."""
        return self.observations.labels()

    @property
    def of_force(self) -> np.ndarray:
        """Return which of the n entries are forces; the others are the flow of images [px]."""
        labels = self.labels
        return (
            (labels["channel"] == "force").to_numpy() if "channel" in labels else np.ones(len(labels), bool)
        )

    @property
    def in_newtons(self) -> Problem:
        """Return the problem of the readings of force alone, which come first."""
        return self if self.flow is None else self.flow.forces

    @property
    def residual(self) -> np.ndarray:
        """Return measured less base (n,)."""
        return self.observations.flat(self.observations.force - self.base)

    @property
    def physics(self) -> list[Candidate]:
        """Return the candidates that are no data-entry errors."""
        return [one for one in self.candidates if not self.effects[one.name].data_entry_error]

    def effect_of(self, part: Any) -> Effect:
        """Return the effect of a part, or of whatever has its name and hyperparameters."""
        return self.effects[part.name]

    def with_model_error(self, terms: Sequence[Term]) -> Problem:
        """Return the problem with the errors of effects' own change in its covariance.

        Those that entries share, and what errs at each entry of the flow on its own.
        """
        errors, covariance = self.errors_of(terms), self.covariance
        if self.flow is not None and any(self.error_of(part) for part, _ in terms):
            change = sum(part.columns @ a for part, a in terms)
            scattered = np.where(self.labels["channel"] == "flow", SCATTERED * change, 0.0) ** 2
            covariance = covariance.scattering(scattered)
        return replace(self, covariance=covariance.erring(errors)) if errors.size else self

    def errors_of(self, terms: Sequence[Term]) -> np.ndarray:
        """Return the directions (n, q) in which a change by effects errs, a standard deviation each.

        What is solved errs by its mesh, and all by form, pressing and sideways forces (and each channel) on their own, as a
        share of the change: one for all depths and one that varies slowly with depth; in images, with the distance from the
        indenter. What has a place errs more, and towards the next places, until a refit has found it.
        """
        in_images = self.flow is not None and bool(self.change_error)
        least = np.where(self.labels["channel"] == "flow", SEEN_ERROR, 0.0) if in_images else 0.0
        errors = [np.zeros((len(self.labels), 0))]
        for part, a in terms:
            change = np.maximum(self.error_of(part), least) * (part.columns @ a)
            if np.any(change):
                errors.append(change[:, None] * self._errs)
                if part.located and part.moved_from is None and self.error_of(part):
                    others = next_to(part, self.places_of(part))
                    errors += [PLACE_ERROR * (other.columns - part.columns) @ a for other in others]
        return np.column_stack(errors)

    @cached_property
    def _errs(self) -> np.ndarray:
        """Return shares (n, k) by which a change errs: of each kind of entry three, whose squares add up to 1."""
        labels = self.labels.assign(pressing=self.labels["axis"] == 2)
        kind = labels.groupby([name for name in ("channel", "pressing") if name in labels]).ngroup()
        c, s = slowly(labels["errs_over" if "errs_over" in labels else "depth_mm"].to_numpy(float))
        shares = np.column_stack([np.ones_like(c), c**2 - s**2, 2 * c * s]) / np.sqrt(2)
        return np.column_stack(
            [np.where((kind == k).to_numpy()[:, None], shares, 0.0) for k in kind.unique()]
        )

    def readings_of(self, mask: np.ndarray) -> np.ndarray:
        """Return (R,) bool: the readings of which some entry (n,) bool is chosen."""
        chosen = np.zeros(len(self.observations.table), bool)
        chosen[self.labels["reading"].to_numpy()[mask]] = True
        return chosen

    def error_of(self, part: Candidate) -> float:
        """Return by which share the change by an effect errs: by the mesh where it is solved, and by form.

        Not at all where errors are none.
        """
        if not self.change_error or self.effects[part.name].data_entry_error:
            return 0.0
        least = max(self.change_error if self.solves(part) else 0.0, part.form_error)
        return max(least, PLACE_ERROR) if part.located and part.moved_from is None else least

    def solves(self, part: Candidate) -> bool:
        """Return whether an effect is solved by the finite elements."""
        return self.effects[part.name].solved

    def with_changes(self, which: Callable[[Candidate], bool], change_of: ForcesWith) -> Problem:
        """Return the problem in which the change (R, 3) [N] by some parts is a function of these and of the rows.

        Other parts act on the forces that result: what reads them does so exactly, the rest by linear changes.
        """

        def forces_with(terms: Sequence[Term], rows: np.ndarray) -> np.ndarray:
            chosen = [term for term in terms if which(term[0])]
            others = [term for term in terms if not which(term[0])]
            if not chosen:
                return self.forces_with(terms, rows)
            change = change_of(chosen, rows)
            if self.read_with is None:
                forces = self.base + change + self.linear_change(others)
            else:
                forces = self.read_with(others, change)
            return np.where(rows[:, None], forces, np.nan)

        return replace(self, forces_with=forces_with)

    def linearised(self) -> Problem:
        """Return the problem with what is solved changing by its columns; what costs nothing acts as it does."""
        return self.with_changes(self.solves, lambda terms, rows: self.linear_change(terms))

    def with_linear_history(self) -> Problem:
        """Return the problem with forces that take what is solved in order (softening) for linear.

        To follow all indentations anew at every value takes minutes: a fit does so once, about its end.
        """

        def forces_with(terms: Sequence[Term], rows: np.ndarray) -> np.ndarray:
            slow = [term for term in terms if self.path_dependent([term[0]])]
            forces = self.forces_with([term for term in terms if not self.path_dependent([term[0]])], rows)
            return forces + self.linear_change(slow) if slow else forces

        return replace(self, forces_with=forces_with)

    def path_dependent(self, parts: Sequence[Candidate]) -> bool:
        """Return whether something that is solved in order is among some effects."""
        return any(self.effects[part.name].path_dependent for part in parts)

    def tried(self, part: Candidate) -> Candidate:
        """Return the problem's own candidate of a part's effect at the hyperparameters that were tried."""
        return next(c for c in self.candidates if c.name == part.name and c.tried == part.tried)

    def slopes_of(self, part: Candidate) -> dict[str, Slope]:
        """Return what `places.slopes` gives of a part; nothing where it has no place or nothing is solved for it."""
        located = part.located and self.solves(part)
        return slopes(self.tried(part), self.places_of(part)) if located else {}

    def places_of(self, part: Candidate) -> list[Candidate]:
        """Return the problem's candidates of a part's effect, one for each point of its grid."""
        return [c for c in self.candidates if c.name == part.name]

    def columns_at(self, part: Candidate) -> np.ndarray:
        """Return the linear change (n, p) per unit by a part at its place, between places to first order."""
        origin, columns = self.tried(part), self.tried(part).columns
        for axis, slope in self.slopes_of(part).items():
            moved = float(part.hyperparameters[axis]) - float(origin.hyperparameters[axis])
            columns = columns + moved * slope.columns
        return columns

    def at_its_place(self, part: Candidate) -> Candidate:
        """Return a part with the problem's columns of all entries at the part's own place."""
        return replace(part, columns=self.columns_at(part))

    def linear_change(self, terms: Sequence[Term]) -> np.ndarray:
        """Return the change (R, 3) [N] of the readings by parts at their places, to first order; 0 where none was read."""
        change = np.zeros_like(self.base)
        change[self.observations.read] = sum(self.columns_at(part) @ np.asarray(a) for part, a in terms)
        return change


def secant(columns: np.ndarray, missing: np.ndarray, step: np.ndarray, prior_sd: np.ndarray) -> np.ndarray:
    """Return columns that along a step change by as much more as was missing.

    Of all such columns those nearest to the given ones, in plausible values (Broyden 1965,
    doi:10.1090/S0025-5718-1965-0198670-6).

    Parameters
    ----------
    columns : numpy.ndarray
        (n, p) [N per unit].
    missing : numpy.ndarray
        (n,), solved change less that by the columns [N].
    step : numpy.ndarray
        (p,), not zero.
    prior_sd : numpy.ndarray
        (p,), standard deviations of the priors.

    Returns
    -------
    numpy.ndarray
        (n, p) [N per unit].
    """
    share = step / prior_sd**2
    return columns + np.outer(missing, share / (step @ share))
