"""Friction, sheet thickness, indentations of a ball and pairs of load cells as measured effects."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from gelforge.materials.basis.common_form import ForcePair, IndentationTest
from gelforge.materials.basis.measured_effects import MeasuredEffect
from gelforge.materials.basis.statistics import Mean, grouped, mean_of
from gelforge.materials.small_tests.microindentation import adhesion, fit_modulus
from gelforge.materials.small_tests.trials import FRICTION, gain_mismatch, pressed_pairs

T_INTERVAL = "Student's t over the trials"
# Of the largest force of an indentation: as much as load cells of class 1 may be off (ISO 7500-1:2018).
NOTABLE_OFFSET = 0.01


@dataclass(frozen=True)
class Press:
    """A ball pressed into a layer, its thickness on a rigid base, and the same indentation on a rigid board."""

    test: IndentationTest
    thickness_mm: float | None = None
    board: IndentationTest | None = None


@dataclass(frozen=True)
class SmallTests:
    """What a material has besides tests that a law is fitted to."""

    friction: Mean | None = None
    thickness: dict[str, Mean] = field(default_factory=dict)
    presses: tuple[Press, ...] = ()
    force_pairs: tuple[ForcePair, ...] = ()

    @property
    def contacts(self) -> list[IndentationTest | ForcePair]:
        """Return the tests that are read from tables of rows: indentations and pairs of load cells."""
        return [*(press.test for press in self.presses), *self.force_pairs]


def small_effects(small: SmallTests) -> tuple[list[MeasuredEffect], list[tuple[str, str]]]:
    """Return the effects that the small tests measure, and what could not be judged."""
    effects, not_judged = [], []
    if small.friction:
        effects.append(_friction(small.friction))
    else:
        not_judged.append(("friction", f"no {FRICTION} with tilt trials"))
    if small.thickness:
        effects.append(_thickness(small.thickness))
    for press in small.presses:
        if press.test.is_the_board:
            not_judged.append(
                ("microindentation", f"{press.test.source} is the test on the rigid board itself")
            )
        elif press.test.ball_radius_mm is not None:
            _keep(effects, not_judged, "microindentation", lambda press=press: _modulus(press))
        if press.test.segment is not None:
            _keep(effects, not_judged, "adhesion", lambda press=press: _adhesion(press.test))
            effects += [_creep(press.test, name) for name, kind in press.test.segment_kinds if kind == "hold"]
    moduli = [e for e in effects if e.effect == "microindentation"]
    if len(moduli) > 1:
        effects.append(_mean_modulus(moduli))
    for pair in small.force_pairs:
        _keep(effects, not_judged, "load_cell_gain", lambda pair=pair: _gain(pair))
    return effects, not_judged


def _keep(effects: list, not_judged: list, effect: str, measure) -> None:
    """Add what is measured, or why it could not be."""
    try:
        effects.append(measure())
    except ValueError as error:
        not_judged.append((effect, str(error)))


def _friction(mu: Mean) -> MeasuredEffect:
    low, high = mu.interval
    sentence = (
        f"The static friction coefficient is {mu.value:.3f} (95 % interval {low:.3f} to {high:.3f}, {mu.count} tilt"
        f" trials that scatter by {mu.deviation:.3f})."
    )
    parameters = {"deviation": mu.deviation, "trials": mu.count}
    return MeasuredEffect(
        effect="friction",
        test="tilt",
        quantity="static friction coefficient",
        value=mu.value,
        interval=mu.interval,
        interval_from=T_INTERVAL,
        unit="1",
        verdict="measured",
        sentence=sentence,
        samples=(),
        parameters=parameters,
    )


def _thickness(by_sample: dict[str, Mean]) -> MeasuredEffect:
    single = len(by_sample) == 1
    mean = next(iter(by_sample.values())) if single else mean_of([m.value for m in by_sample.values()])
    error = float(np.sqrt(np.mean([(m.standard_error / m.value) ** 2 for m in by_sample.values()])))
    low, high = mean.interval
    sentence = (
        f"The sheets are {mean.value:.4g} mm thick (95 % interval {low:.4g} to {high:.4g}, {len(by_sample)} sample"
        f"{'' if single else 's'}); the thickness of one sample is known to {error:.2%}, and so is its stress."
    )
    parameters = {
        "relative_standard_error_of_a_sample": error,
        "thickness_mm_by_sample": {name: m.value for name, m in by_sample.items()},
    }
    return MeasuredEffect(
        effect="sheet_thickness",
        test="sections",
        quantity="thickness of the sheets",
        value=mean.value,
        interval=mean.interval,
        interval_from=f"Student's t over the {'sections' if single else 'samples'}",
        unit="mm",
        verdict="measured",
        sentence=sentence,
        samples=tuple(by_sample),
        parameters=parameters,
    )


def _modulus(press: Press) -> MeasuredEffect:
    loading = next((name for name, kind in press.test.segment_kinds if kind == "load"), None)
    loaded = press.test if loading is None else press.test.in_segment(loading)
    fit, name = fit_modulus(loaded, press.thickness_mm, press.board), press.test.sample
    low, high = fit.interval
    said = f" Beware: {'; '.join(fit.warnings)}." if fit.warnings else ""
    sentence = (
        f"{name}: Young's modulus {fit.youngs_modulus:.4g} MPa (95 % interval {low:.4g} to {high:.4g}), contact at"
        f" {fit.contact_mm:.4g} mm, the layer's thickness raises the force by {fit.correction - 1:.1%}.{said}"
    )
    source = "bootstrap of the indentation's residuals (one indentation)"
    parameters = {
        "ball_radius_mm": press.test.ball_radius_mm,
        "layer_thickness_mm": press.thickness_mm,
        "contact_mm": fit.contact_mm,
        "largest_depth_mm": fit.largest_depth_mm,
        "layer_factor": fit.correction,
    }
    return MeasuredEffect(
        effect="microindentation",
        test="indentation",
        quantity="Young's modulus by Hertz with thin-layer correction",
        value=fit.youngs_modulus,
        interval=fit.interval,
        interval_from=source,
        unit="MPa",
        verdict="measured",
        sentence=sentence,
        samples=(name,),
        parameters=parameters,
    )


def _mean_modulus(moduli: list[MeasuredEffect]) -> MeasuredEffect:
    mean = mean_of([m.value for m in moduli])
    low, high = mean.interval
    sentence = f"The mean of {mean.count} indentations is {mean.value:.4g} MPa (95 % interval {low:.4g} to {high:.4g})."
    samples = tuple(m.samples[0] for m in moduli)
    return MeasuredEffect(
        effect="microindentation",
        test="indentation",
        quantity="Young's modulus, mean of indentations",
        value=mean.value,
        interval=mean.interval,
        interval_from="Student's t over the indentations",
        unit="MPa",
        verdict="measured",
        sentence=sentence,
        samples=samples,
        parameters={"deviation_MPa": mean.deviation},
    )


def _creep(test: IndentationTest, segment: str) -> MeasuredEffect:
    """Return by how much a hold moves and by how much its force changes, from its first row to its last."""
    held = test.in_segment(segment)
    moved, changed = (float(values[-1] - values[0]) for values in (held.position_mm, held.force_N))
    force, noise = float(held.force_N[0]), 2.0 * _row_noise(held.position_mm)
    lasts = None if held.time_s is None else float(held.time_s[-1] - held.time_s[0])
    time = "" if lasts is None else f" of {lasts:.4g} s"
    share = f", {changed / force:+.1%}" if force else ""
    sentence = (
        f"{test.sample}: In the hold{time} the ball sinks by {moved * 1e3:.3g} um and the force changes by {changed:.2g} N"
        f"{share}."
    )
    parameters = {"hold_s": lasts, "force_change_N": changed, "force_N": force}
    return MeasuredEffect(
        effect="relaxation",
        test="indentation",
        quantity="further depth in a hold",
        value=moved,
        interval=(moved - noise, moved + noise),
        interval_from="scatter of neighbouring rows (one indentation)",
        unit="mm",
        verdict="measured",
        sentence=sentence,
        samples=(test.sample,),
        parameters=parameters,
    )


def _row_noise(values: np.ndarray) -> float:
    """Return the standard deviation of the difference of two rows, from how far rows are off their neighbours' mean."""
    if len(values) < 3:
        return 0.0
    off = values[1:-1] - (values[:-2] + values[2:]) / 2  # variance 1.5 times that of a row
    return float(np.sqrt(2 / 1.5) * np.std(off))


def _adhesion(test: IndentationTest) -> MeasuredEffect:
    assert test.segment is not None  # small_effects asks only then
    names = list(dict.fromkeys(test.segment))
    ways = [float(np.subtract(*test.in_segment(name).position_mm[[-1, 0]])) for name in names]
    into = next((name for name, way in zip(names, ways) if way > 0), None)
    out = next((name for name, way in zip(names[::-1], ways[::-1]) if way < 0), None)
    if into is None or out is None:
        raise ValueError(
            f"{test.source}: its segments {names} have no approach or no withdrawal; both are needed"
        )
    pulled = adhesion(test.in_segment(into), test.in_segment(out))
    noise = 2 * pulled.noise_N / pulled.largest_push_N
    interval: tuple[float, float] | None = None
    verdict, source = "cannot be judged", "none: the ball stays attached"
    if pulled.detached:
        verdict = "significant adhesion" if "significant" in pulled.sentence else "negligible"
        interval, source = (
            (pulled.ratio - noise, pulled.ratio + noise),
            "noise of the force (one indentation)",
        )
    sentence = f"{test.sample}: {pulled.sentence}"
    parameters = {"pull_off_N": pulled.pull_off_N, "largest_push_N": pulled.largest_push_N}
    return MeasuredEffect(
        effect="adhesion",
        test="indentation",
        quantity="pull-off force over the largest push",
        value=pulled.ratio,
        interval=interval,
        interval_from=source,
        unit="1",
        verdict=verdict,
        sentence=sentence,
        samples=(test.sample,),
        parameters=parameters,
    )


def _gain(pair: ForcePair) -> MeasuredEffect:
    mean, presses = gain_mismatch(pair), pressed_pairs(pair)
    low, high = mean.interval
    gains = grouped((p.place, p.gain) for p in presses)
    offsets = [p.offset_N / p.largest_N for p in presses]
    single = [float(np.std(v, ddof=1)) for v in gains.values() if len(v) > 1]
    within = max(single, default=float("nan"))
    text = (
        f"The second load cell's gain is {mean.value:+.1%} off that of the first (95 % interval {low:+.1%} to"
        f" {high:+.1%}, {mean.count} independent places; slope of force over force, both measured)"
    )
    place_matters = pair.position is not None and mean.deviation > 3 * within
    if place_matters:
        listed = ", ".join(f"{np.mean(v):+.1%} at {place}" for place, v in gains.items())
        text += (
            f": it depends on where the body is pressed ({listed}; within {within:.1%} at one place), so one gain does"
            " not describe it; part of the force bypasses a load cell, or the load cells also respond to moments"
        )
    if max(map(abs, offsets)) > NOTABLE_OFFSET:
        text += f"; an offset of {min(offsets):+.1%} to {max(offsets):+.1%} of the force comes with the load and is no gain"
    verdict = "undecided" if low <= 0 <= high else "significant gain"
    if place_matters:
        verdict = "depends on the place"

    def mean_by_place(values: Iterable[float]) -> dict[str, float]:
        of_places = grouped(zip((p.place for p in presses), values))
        return {str(place): float(np.mean(v)) for place, v in of_places.items()}

    parameters = {
        "gain_by_place": mean_by_place(p.gain for p in presses),
        "ratio_at_largest_force_by_place": mean_by_place(p.ratio for p in presses),
        "offset_under_load_N_by_place": mean_by_place(p.offset_N for p in presses),
        "deviation_within_a_place": within if np.isfinite(within) else None,
    }
    return MeasuredEffect(
        effect="load_cell_gain",
        test="force_pair",
        quantity="force of the second load cell over the first (slope), less 1",
        value=mean.value,
        interval=mean.interval,
        interval_from="Student's t over the places",
        unit="1",
        verdict=verdict,
        sentence=f"{text}.",
        samples=(pair.sample,),
        parameters=parameters,
    )
