"""What these readings cannot tell from each effect of an answer, and how sure they are of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gelforge.mismatch.alternatives import WORTH, Alternatives, normalised
from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.identifiability import Group, group_of_winner
from gelforge.mismatch.screen import Screened
from gelforge.mismatch.verdict import NAMED_PROBABILITY

MOST_MEMBERS = 4  # of a group that is widened by rivals
LIKELY = 0.5  # probability below which a group is no answer


def grouped(
    ranked: Sequence[Screened], covariance: Covariance, alternatives: Alternatives, alone: bool = True
) -> Group:
    """Return the group of the first of some effects, what else was answered being the same.

    Its members and odds follow from these; its probability from all answers, of one effect and of several: however many of
    its like a group holds, where pairs of others do as well it is not sure. Odds are with or without errors of changes,
    whichever say less: one effect is exact and another errs, and of two that are alike that alone would decide.

    alone: it is all that was answered, and is widened by rivals where it is not sure. Beside another effect it is not: that
    one's own form leaves a rest, and four of a catalogue always take it up, whatever it is.
    """
    chances = normalised({judged.name: WORTH * judged.log_bayes_factor for judged in ranked})
    group = group_of_winner(ranked, covariance, chances)
    group = _widened(group if alone else replace(group, rivals=()), chances, alternatives)
    exact = normalised(
        {judged.name: WORTH * (judged.log_bayes_factor - judged.error_cost) for judged in ranked}
    )
    others = sum(exact[name] for name in group.members[1:])
    return replace(group, odds=min(group.odds, exact[group.members[0]] / others)) if others > 0 else group


def claimed(groups: Sequence[Group]) -> tuple[Group, ...]:
    """Return the groups of an answer without those that are not sure, where others are.

    What is sure is in nearly every answer, whichever effect it is that takes up the little that is left beside it.
    """
    return tuple(group for group in groups if group.probability >= NAMED_PROBABILITY) or tuple(groups)


def last_alone(judged: Screened) -> Screened:
    """Return the last effect of several as one of its own, with its share of the change."""
    last = judged.parts[-1]
    p = last.columns.shape[1]
    amounts = judged.amounts[-p:]
    own = judged.covariance[-p:, -p:]
    return replace(judged, parts=(last,), amounts=amounts, covariance=own, change=last.columns @ amounts)


def _widened(group: Group, chances: Mapping[str, float], alternatives: Alternatives) -> Group:
    """Return a group with the rivals, most probable first, without which it is not NAMED_PROBABILITY sure.

    They leave another pattern, but these readings are too few to say which it is.
    """
    members = list(group.members)
    for rival in sorted(group.rivals, key=lambda name: -chances[name]):
        if alternatives.holding(members) >= NAMED_PROBABILITY or len(members) >= MOST_MEMBERS:
            break
        members.append(rival)
    others = sum(chances[name] for name in members[1:])
    odds = chances[members[0]] / others if others > 0 else np.inf
    return replace(group, members=tuple(members), probability=alternatives.holding(members), odds=float(odds))
