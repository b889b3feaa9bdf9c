"""One line on the network: whether it is good, where it fails, what more data would help."""

from __future__ import annotations

import numpy as np
import pandas as pd

CLEARLY = 0.9  # of the best baseline's error: closer is a tie
WORSE = 1.5  # times the other classes' error, beside which a class stands out
OVERFIT = 2.0  # validation loss over training loss
HELD = (0.85, 0.97)  # shares inside 90 % intervals that a few validation orbits allow

ERROR = "RMSES_z_N"
AFTER_SIMULATION = (
    "It has learnt from simulated sensors alone: fit its gains to a few recorded indentations (gelforge adapt), and"
    " learn from "
    "recordings too (synthesis.train_on: both) where that is not enough."
)


def network_words(
    baselines: pd.DataFrame,
    by: pd.DataFrame,
    reliability: pd.DataFrame,
    loss: pd.DataFrame | None,
    only_simulated: bool = False,
) -> str:
    """Return the verdict on the network in a paragraph: against baselines, by class, of intervals, and the remedy.

    only_simulated: nothing was learnt from recordings, so that the loss says nothing of them.
    """
    error = baselines.set_index("predictor")[ERROR]
    own, others = float(error["network"]), error.drop(["network", "zero"]).dropna()
    if not np.isfinite(own) or not len(others):
        return "No test row is pressed: nothing can be said of the network."
    ratio = own / float(others.min())
    verdict = (
        "good" if ratio < CLEARLY else "no better than a baseline" if ratio < 1 / CLEARLY else "of no use"
    )
    found = (
        f"The network is {verdict}. Vertical force of a pressed bin: {_mN(own)} rms error, {ratio:.2g} times that of the "
        f"best baseline ({others.idxmin()}, {_mN(others.min())})."
    )
    remedy = AFTER_SIMULATION if only_simulated else _remedy(by, loss, verdict == "good")
    return " ".join(part for part in (found, _where(by), _intervals(reliability), remedy) if part)


def _where(by: pd.DataFrame) -> str:
    """Return the class of places whose error stands out, and the depth of the largest error of the total."""
    found = _outstanding(by, "place")
    depth = by[by["by"] == "depth"]
    words = []
    if found is not None:
        words.append(f"It errs most {found['class']}: {_mN(found[ERROR])} per pressed bin.")
    if len(depth) > 1:
        worst = depth.loc[depth["total_Fz_rms_N"].idxmax()]
        words.append(
            f"Its total force errs most at depths of {worst['class']}: {_mN(worst['total_Fz_rms_N'])}."
        )
    return " ".join(words)


def _outstanding(by: pd.DataFrame, kind: str) -> pd.Series | None:
    """Return the class of a kind whose error stands out from the median of the others, or None."""
    classes = by[(by["by"] == kind) & np.isfinite(by[ERROR])]
    if len(classes) < 2:
        return None
    worst = classes.loc[classes[ERROR].idxmax()]
    others = classes.drop(index=worst.name)[ERROR].median()
    return worst if worst[ERROR] > WORSE * others else None


def _intervals(reliability: pd.DataFrame) -> str:
    value = reliability.set_index("quantity")["value"]
    held = {
        kind: [value.get(f"{kind}, {axis}: share inside the 90 % interval", np.nan) for axis in "xyz"]
        for kind in ("bins", "totals")
    }
    known = {kind: shares for kind, shares in held.items() if np.isfinite(shares).all()}
    if not known:
        return "It states no intervals: too few validation rows."
    few = [f"{kind} {100 * min(shares):.0f} %" for kind, shares in known.items() if min(shares) < HELD[0]]
    if few:
        return f"Its 90 % intervals hold fewer of the test rows ({', '.join(few)} of an axis): distrust them."
    if max(map(max, known.values())) > HELD[1]:
        return "Its 90 % intervals hold more of the test rows than they say: they are wide."
    return "Its 90 % intervals hold what they say."


def _remedy(by: pd.DataFrame, loss: pd.DataFrame | None, is_good: bool) -> str:
    """Return what more data would help most, "" where nothing says so."""
    place, session = _outstanding(by, "place"), _outstanding(by, "session")
    if session is not None:
        return f"More sessions would help most: session {session['class']} is unlike the others."
    if place is not None:
        return f"More sites {place['class']} would help most."
    if loss is None or not np.isfinite(loss.validation).any():
        return ""
    best = loss.loc[loss.validation.idxmin()]
    if best.validation > OVERFIT * best.training:
        return (
            "More sites would help: at its best epoch the loss on held-out sites is "
            f"{best.validation / best.training:.1f} times that on training sites."
        )
    if not is_good:
        return ""
    return "The loss on held-out sites is close to that on training sites: more sites of the same kind would help little."


def _mN(newtons: float) -> str:
    return f"{1e3 * newtons:.3g} mN"
