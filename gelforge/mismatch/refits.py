"""The refits of one round of the search: which answers were fitted in the real model, and what all readings say of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

from gelforge.config import ConfigError
from gelforge.mechanics.equilibrium import NotConverged
from gelforge.mismatch.alternatives import effects_of
from gelforge.mismatch.confirmation import NotSolved, forces_of, told_of
from gelforge.mismatch.holdout import Blocks
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.refit import End, Refitted, refitted
from gelforge.mismatch.screen import Screened
from gelforge.mismatch.weighing import unmasked


@dataclass(frozen=True, eq=False)
class Told:
    """What all readings say of a round's refits."""

    best: str  # of the refits
    evidence: Mapping[str, float]  # log, of every refit
    forces: Mapping[str, np.ndarray]  # (R, 3) [N] of those that were solved for all readings
    after: np.ndarray  # (R, 3) [N] of the best


class Refits:
    """Answers fitted to the training readings, by name.

    What is solved in order is taken for linear beside others (Problem.drafted), but for the best.
    """

    def __init__(self, problem: Problem, blocks: Blocks, notes: list[str]):
        self.problem, self.draft, self.blocks, self.notes = problem, problem.drafted(), blocks, notes
        self.fits: dict[str, Refitted] = {}
        self.asked: dict[str, Screened] = {}  # what failed too

    def costs(self, answer: Screened | Refitted) -> bool:
        """Return whether a refit of an answer needs the solver."""
        return any(self.problem.solves(part) for part in answer.parts)

    @property
    def tried(self) -> set[frozenset[str]]:
        """Return the effects of every answer that a refit was asked for."""
        return {effects_of(one) for one in self.asked.values()}

    @property
    def solved(self) -> int:
        """Return how many needed the solver."""
        return sum(self.costs(fit) for fit in self.fits.values())

    @property
    def best(self) -> float:
        """Return the largest log evidence of the training readings; minus infinity of no refit."""
        return max((fit.log_bayes_factor for fit in self.fits.values()), default=-np.inf)

    def add(self, one: Screened, whatever: bool = False) -> None:
        """Refit an answer; one that cannot be solved is noted. whatever: however far behind the best it stays."""
        self.asked[one.name] = one
        beat = -np.inf if whatever else self.best
        try:
            self.fits[one.name] = refitted(self.draft, unmasked(self.problem, one), self.blocks.train, beat)
        except (NotConverged, ConfigError) as failure:  # ConfigError: effects that do not go together
            self.notes.append(f"{one.name} could not be solved at its fitted amount: {failure}")

    def told(self, promising: Collection[str]) -> Told | None:
        """Return what all readings say of the refits, without those that cannot be solved there; None of none.

        The best has been fitted to its end and put there exactly. promising: names of those that all readings are asked of
        however far behind they are.
        """
        asked = list(promising)
        while self.fits:
            try:
                evidence, forces = told_of(self.draft, self.blocks, self.fits, asked)
                best = max(evidence, key=evidence.get)
                if self.blocks.held_out.any() and best not in forces:
                    asked.append(best)
                    self._finish(best)
                    continue
                known = best in forces and not self.problem.in_order_beside(self.fits[best].parts)
                after = forces[best] if known else forces_of(self.problem, self.fits[best])
                return Told(best, evidence, forces, after)
            except NotSolved as failure:  # at other readings than those of the fit
                self.notes.append(
                    f"{failure.name} could not be solved at its fitted amount for all readings: {failure}"
                )
                del self.fits[failure.name]
                self._go_on()
        return None

    def _finish(self, name: str) -> None:
        """Refit one that was broken off, to its end; it is dropped where that cannot be solved."""
        if self.fits[name].end is End.HOPELESS:
            del self.fits[name]
            self.add(self.asked[name], whatever=True)

    def _go_on(self) -> None:
        """Refit those that were broken off for the sake of one that is no more."""
        hopeless = [name for name, fit in self.fits.items() if fit.end is End.HOPELESS]
        for name in hopeless:
            del self.fits[name]
        for name in hopeless:
            self.add(self.asked[name])

    def seat(self, forces: Mapping[str, np.ndarray]) -> Problem:
        """Return the problem with the single effects of which forces (R, 3) [N] are known seated there, and keep it."""
        for name, with_it in forces.items():
            fit = self.fits[name]
            if len(fit.parts) == 1:
                self.problem = self.problem.seated(fit.parts[0], fit.amounts[0], with_it)
        return self.problem
