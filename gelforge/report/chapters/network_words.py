"""A paragraph on the network: where it fails, what its intervals are worth, what more data would help."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.report.chapters.chapter import millinewtons, newtons

CLEARLY = 0.9  # of the best baseline's error: closer is a tie
WORSE = 1.5  # times the other classes' error, next to which a class stands out
# RMSES z on test rows over that on training rows. Above OVERFIT most of the squared error is of places that were not
# learnt. Below UNDERFIT the network errs on what it has seen as on what it has not: it has not fitted it. Above it more
# steps may still help. Measured with the U-Net on the demo's rows: 1.00 after 480 steps, 1.09 after 960, 1.19 after 2,000,
# 1.52 after 6,000, with errors on test rows of 11.9, 4.8, 3.7 and 3.0 mN.
OVERFIT, UNDERFIT = 2.0, 1.1
# A loss that is less in the last tenth of the steps than this share of that in the tenth before still falls. Asked where
# the step size is steady: one that falls to zero flattens any curve (measured: 0.89 to 1.04 after 120 to 6,000 steps,
# whatever is left).
FALLING = 0.95
HELD = (0.85, 0.97)  # shares inside 90 % intervals that a few validation orbits allow

ERROR = "RMSES_z_N"
AFTER_SIMULATION = (
    "The network has learnt from simulated sensors alone: fit its gains to a few recorded indentations (gelforge adapt), and"
    " learn from recordings too (synthesis.train_on: both) where that is not enough."
)


def beside_baselines(baselines: pd.DataFrame) -> tuple[float, float, str] | None:
    """Return RMSES z [N] of the network, of the best baseline, and the latter's name; None where no test row is pressed."""
    error = baselines.set_index("predictor")[ERROR]
    network, others = float(error["network"]), error.drop(["network", "zero"]).dropna()
    return (
        (network, float(others.min()), str(others.idxmin())) if np.isfinite(network) and len(others) else None
    )


def network_words(
    baselines: pd.DataFrame,
    by: pd.DataFrame,
    reliability: pd.DataFrame,
    errors: pd.DataFrame,
    loss: pd.DataFrame | None,
    only_simulated: bool = False,
    has_budget: bool = False,
) -> str:
    """Return in a paragraph where the network fails, what its intervals are worth, and the remedy.

    errors: the table rmse. loss: of a training of steady step size. only_simulated: nothing was learnt from recordings, so
    that errors on training rows say nothing of them. has_budget: the parts of the error are known, and the remedy follows
    from them (`budget_words`), not from here.
    """
    standing = beside_baselines(baselines)
    if standing is None:
        return "No test row is pressed: nothing can be said of the network."
    network, best, _ = standing
    times = over_training_rows(errors)
    early = _ended_early(np.nan if only_simulated else times, loss)
    remedy = "" if has_budget or early else _remedy(by, times, network < CLEARLY * best)
    parts = (_where(by), _intervals(reliability), early, AFTER_SIMULATION if only_simulated else remedy)
    return " ".join(part for part in parts if part)


def over_training_rows(errors: pd.DataFrame) -> float:
    """Return RMSES z on test rows over that on training rows, of the table rmse; NaN where it lacks one."""
    error = errors.set_index("error")["z_N"]
    return float(error["RMSES"] / error.get("RMSES_TRAINING", np.nan))


def _ended_early(times: float, loss: pd.DataFrame | None) -> str:
    """Return that a training ended before its end, "" where nothing says so."""
    if times < UNDERFIT:
        return (
            f"The error on test rows is {times:.2f} times that on training rows: training ended early, or the network is"
            " too small. Try more steps (learning.steps) first."
        )
    if loss is not None and (fall := _last_fall(loss)) < FALLING:
        return (
            f"The loss was still falling, by {100 * (1 - fall):.0f} % in the last tenth of the steps: more steps"
            " (learning.steps) would help."
        )
    return ""


def _last_fall(loss: pd.DataFrame) -> float:
    """Return the mean training loss of the last tenth of the steps over that of the tenth before; NaN: too few rows."""
    share = loss.step / loss.step.max()
    before, last = loss.training[(share > 0.8) & (share <= 0.9)], loss.training[share > 0.9]
    return float(last.mean() / before.mean())


def _where(by: pd.DataFrame) -> str:
    """Return the class of places whose error stands out, and the depth of the largest error of the total."""
    outstanding = _outstanding(by, "place")
    depth = by[by["by"] == "depth"]
    words = []
    if outstanding is not None:
        words.append(
            f"The error of a pressed bin is largest {outstanding['class']}: {millinewtons(outstanding[ERROR])}."
        )
    if len(depth) > 1:
        worst = depth.loc[depth["total_Fz_rms_N"].idxmax()]
        words.append(
            f"The error of the total force is largest at depths of {worst['class']}:"
            f" {newtons(worst['total_Fz_rms_N'])}."
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
        return "The network states no intervals: too few validation rows."
    few = [
        f"{100 * min(shares):.0f} % of the {kind}" for kind, shares in known.items() if min(shares) < HELD[0]
    ]
    if few:
        return (
            f"The network's 90 % intervals are too narrow: along one axis they hold {' and '.join(few)} only."
        )
    if max(map(max, known.values())) > HELD[1]:
        return "The network's 90 % intervals are wider than they need to be."
    return "The network's 90 % intervals hold nine in ten of the test rows, as they should."


def _remedy(by: pd.DataFrame, times: float, is_good: bool) -> str:
    """Return what more data would help most, "" where nothing says so; times: over_training_rows."""
    place, session = _outstanding(by, "place"), _outstanding(by, "session")
    if session is not None:
        return f"More sessions would help most: session `{session['class']}` is unlike the others."
    if place is not None:
        return f"More sites {place['class']} would help most."
    if times > OVERFIT:
        return (
            f"More sites would help: the error on held-out sites is {times:.1f} times that on training rows."
        )
    if not is_good or np.isnan(times):
        return ""
    return "The error on held-out sites is close to that on training rows: more sites of the same kind would help little."
