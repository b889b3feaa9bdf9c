"""A trained model on another sensor of its kind: gains from a few indentations whose total force was measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from gelforge.dataset.shard import ShardDataset
from gelforge.learning.basis.data import BLOCK, FEATURE
from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.models.model_file import Model
from gelforge.learning.models.reliability import COVER, Intervals
from gelforge.progress import tracked

# A sensor of another gain is corrected, and only as far as its presses determine it (tests/learning/test_adaptation.py):
LEAST_PRESSES = 5
GAIN_LIMITS = (0.2, 5.0)  # beyond them the sensor is not of the model's kind
# Of the error left out that a further gain must come below: of no gain, one and two the simplest is taken
# (tests/learning/test_adaptation.py).
LEAST_GAIN = 0.95
SURE = 0.1  # standard deviation of a gain that is taken; small horizontal forces determine none
# which axes share a gain, from none to one for the horizontal and one for the vertical force
FORMS = {"none": (), "one gain": ((0, 1, 2),), "horizontal and vertical gain": ((0, 1), (2,))}


@dataclass(frozen=True)
class Presses:
    """Rows of some indentations: what the images showed and what the force sensor read."""

    feature: np.ndarray  # (n, F)
    measured: np.ndarray  # (n, 3) [N]
    press: np.ndarray  # (n,) text

    def of(self, chosen: np.ndarray) -> Presses:
        return Presses(self.feature[chosen], self.measured[chosen], self.press[chosen])


@dataclass(frozen=True)
class Adaptation:
    """How a model was adapted: which gains, chosen among which by the error on indentations left out."""

    form: str
    gain: np.ndarray  # (3,)
    left_out_N: dict[str, float]  # rms error of the total force on indentations left out, by form
    widened: np.ndarray  # (3,) times the intervals of totals


def press_names(rows: ShardDataset) -> np.ndarray:
    """Return for each row the indentation whose force was measured.

    Parameters
    ----------
    rows : ShardDataset
        N rows.

    Returns
    -------
    numpy.ndarray
        (N,) of "session/press"; "" for an untouched or unmeasured row.
    """
    names = [np.empty(0, object)]
    for block in rows.batches(("total_force_ft_N", "untouched", "press", "session"), 8192):
        known = ~block["untouched"] & np.isfinite(block["total_force_ft_N"]).all(axis=1)
        pressed = [f"{s}/{p}" if k else "" for s, p, k in zip(block["session"], block["press"], known)]
        names.append(np.array(pressed, object))
    return np.concatenate(names)


def measured_presses(rows: ShardDataset, names: np.ndarray, chosen: set[str] | None = None) -> Presses:
    """Return the rows of indentations whose force was measured.

    Parameters
    ----------
    rows : ShardDataset
        N rows.
    names : numpy.ndarray
        (N,), as `press_names` returns them.
    chosen : set of str, optional
        Names of the indentations; all if not given.

    Returns
    -------
    Presses
        Features (n, F), total forces (n, 3) [N] and names (n,).
    """
    index = np.flatnonzero([name != "" and (chosen is None or name in chosen) for name in names])
    if not len(index):
        return Presses(np.empty((0, 0)), np.empty((0, 3)), np.empty(0, object))
    block = rows.read(index, (FEATURE, "total_force_ft_N"))
    return Presses(block[FEATURE], block["total_force_ft_N"], names[index])


def drawn_presses(names: np.ndarray, count: int, seed: int) -> set[str]:
    """Return the names of indentations drawn at random.

    Parameters
    ----------
    names : numpy.ndarray
        (N,), as `press_names` returns them.
    count : int
        How many.
    seed : int
        Of the draw.

    Returns
    -------
    set of str
        `count` names.

    Raises
    ------
    ModelError
        For more than there are or fewer than LEAST_PRESSES.
    """
    known = np.unique(names[names != ""].astype(str))
    if not LEAST_PRESSES <= count <= len(known):
        raise ModelError(
            f"{count} indentations asked for, {len(known)} are there with images and measured forces; give between "
            f"{LEAST_PRESSES} and that"
        )
    return set(np.random.default_rng(seed).choice(known, count, replace=False).tolist())


def adapt(model: Model, presses: Presses) -> tuple[Model, Adaptation]:
    """Return the model with gains that make its totals those measured, and how they were chosen.

    Gains are least squares through zero. Of no gain, one, and two, the simplest is taken that no other with sure gains
    betters clearly on indentations left out one at a time. Thresholds follow the gain; intervals follow it too,
    and those of totals are widened or narrowed to hold nine in ten of the errors at hand.

    Parameters
    ----------
    model : Model
        Trained.
    presses : Presses
        Features, and measured total forces [N] of another sensor.

    Returns
    -------
    Model
        A copy; its settings state the gains.
    Adaptation
        Form and gains [-], errors of each form, and how far intervals were widened [-].

    Raises
    ------
    ModelError
        For a vertical gain of no sensor of the model's kind.
    """
    said = predicted(model, presses.feature).sum(axis=1)  # (n, 3)
    error = {form: _left_out(said, presses, axes) for form, axes in FORMS.items()}
    form = next(iter(FORMS))
    for other, axes in FORMS.items():
        usable = all(_is_usable(said, presses, shared) for shared in axes)
        form = other if usable and error[other] < LEAST_GAIN * error[form] else form
    gain = _gains(said, presses.measured, FORMS[form])
    vertical = _gains(said, presses.measured, ((2,),))[2]
    if not GAIN_LIMITS[0] <= vertical <= GAIN_LIMITS[1]:
        raise ModelError(
            f"a vertical gain of {vertical:.3g}, limits {GAIN_LIMITS}: the sensor is not of the model's kind, "
            "or its readings have other axes or signs"
        )
    changed = _with_gain(model, gain.astype(np.float32))
    widened = _widening(changed, presses)
    if changed.intervals:
        changed = replace(changed, intervals=_scaled(changed.intervals, np.ones(3), widened))
    settings = changed.settings | {"adapted": {"gain": gain.tolist(), "presses": len(set(presses.press))}}
    return replace(changed, settings=settings), Adaptation(form, gain, error, widened)


def _gains(said: np.ndarray, measured: np.ndarray, axes: tuple[tuple[int, ...], ...]) -> np.ndarray:
    """Return the gain of each axis (3,): least squares through zero over the axes that share one, 1 where none is found."""
    gain = np.ones(3)
    for shared in axes:
        there, wanted = said[:, shared].ravel(), measured[:, shared].ravel()
        if there @ there > 0:
            gain[list(shared)] = there @ wanted / (there @ there)
    return gain


def _is_usable(said: np.ndarray, presses: Presses, shared: tuple[int, ...]) -> bool:
    """Return whether indentations determine the gain that axes share; forces of straight ones aside are too small to."""
    gain = _gains(said, presses.measured, (shared,))[shared[0]]
    return GAIN_LIMITS[0] <= gain <= GAIN_LIMITS[1] and _deviation(said, presses, shared) < SURE


def _deviation(said: np.ndarray, presses: Presses, shared: tuple[int, ...]) -> float:
    """Return the standard deviation of a gain that axes share; rows of one indentation err together and count as one."""
    there, wanted = said[:, shared], presses.measured[:, shared]
    size = float((there**2).sum())
    if not size:
        return np.inf
    left = wanted - there * float((there * wanted).sum() / size)
    _, press = np.unique(presses.press.astype(str), return_inverse=True)
    of_press = np.bincount(press, (there * left).sum(axis=1))
    return float(np.sqrt((of_press**2).sum()) / size)


def _left_out(said: np.ndarray, presses: Presses, axes: tuple) -> float:
    """Return the rms length [N] of the total's error on indentations left out one at a time."""
    errors = []
    for name in np.unique(presses.press.astype(str)):
        out = presses.press == name
        errors.append(said[out] * _gains(said[~out], presses.measured[~out], axes) - presses.measured[out])
    return float(np.sqrt((np.concatenate(errors) ** 2).sum(axis=1).mean()))


def _with_gain(model: Model, gain: np.ndarray) -> Model:
    scale, mean = model.scaling.output_scale * gain, model.scaling.output_mean * gain
    scaling = replace(model.scaling, output_scale=scale, output_mean=mean)
    # thresholds are of lengths that the vertical force decides
    contact_N, bin_N = (float(length * gain[2]) for length in (model.zero.contact_N, model.zero.bin_N))
    zero = replace(model.zero, contact_N=contact_N, bin_N=bin_N)
    intervals = _scaled(model.intervals, gain, np.ones(3)) if model.intervals else None
    check = replace(model.check, gain=model.check.gain * gain) if model.check else None
    return replace(model, scaling=scaling, zero=zero, intervals=intervals, check=check)


def _scaled(intervals: Intervals, gain: np.ndarray, widened: np.ndarray) -> Intervals:
    """Return intervals for forces times gain (3,), those of totals wider by factors (3,)."""
    return replace(
        intervals,
        bin_edges_N=intervals.bin_edges_N * gain[2],
        bin_half_N=intervals.bin_half_N * gain,
        bin_sigma_N=intervals.bin_sigma_N * gain,
        total_edges_N=intervals.total_edges_N * gain[2],
        total_half_N=intervals.total_half_N * gain * widened,
        total_sigma_N=intervals.total_sigma_N * gain,
    )


def _widening(model: Model, presses: Presses) -> np.ndarray:
    """Return the factors (3,) that make the intervals of totals hold nine in ten of each axis' errors at hand."""
    if model.intervals is None:
        return np.ones(3)
    force = predicted(model, presses.feature)
    error = np.abs(force.sum(axis=1) - presses.measured)
    ratio = np.sort(error / np.maximum(model.intervals.of_totals(force), 1e-9), axis=0)
    return np.maximum(ratio[min(int(np.ceil((len(ratio) + 1) * COVER)), len(ratio)) - 1], 1e-3)


def predicted(model: Model, feature: np.ndarray) -> np.ndarray:
    """Return distributions (n, B, 3) [N] of features (n, F), a block at a time."""
    blocks = tracked(np.array_split(feature, -(-len(feature) // BLOCK)), f"blocks of {BLOCK} rows predicted")
    return np.concatenate([model.predict(part) for part in blocks])


def errors_table(models: dict[str, Model], presses: Presses) -> pd.DataFrame:
    """Return the rms error of the total force of models on indentations, and the share in their 90 % intervals.

    Parameters
    ----------
    models : dict of str to Model
        By name.
    presses : Presses
        Features and measured total forces [N].

    Returns
    -------
    pandas.DataFrame
        A row for each model: rms [N] and share [-] by axis, the share NaN without intervals.
    """
    rows = []
    for name, model in models.items():
        force = predicted(model, presses.feature)
        error = force.sum(axis=1) - presses.measured
        rms = np.sqrt((error**2).mean(axis=0))
        held = [np.nan] * 3
        if model.intervals:
            held = (np.abs(error) <= model.intervals.of_totals(force)).mean(axis=0)
        rows.append((name, *rms, *held))
    axes: Sequence[str] = "xyz"
    columns = ["model", *(f"total_{a}_rms_N" for a in axes), *(f"{a}_in_90_percent" for a in axes)]
    return pd.DataFrame(rows, columns=columns)
