"""A judgement put into the form of verdict.json and its tables: effects, fit, places, limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from scipy.stats import norm

from gelforge.config import Sensor
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.gaussian import NOTHING, UNKNOWN
from gelforge.mismatch.evidence.identifiability import detection_limits
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.refit import Refitted
from gelforge.mismatch.evidence.screen import Candidate, Screened
from gelforge.mismatch.inference.judge import Answer, Judgement
from gelforge.mismatch.inference.scan import ResidualTests
from gelforge.mismatch.model.effect import Parameter
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.result.scores import by_axis, score
from gelforge.mismatch.summary.sections import model_section
from gelforge.mismatch.summary.words import sentence_of, shortcomings
from gelforge.mismatch.thresholds import ALARM_P, NEGLIGIBLE
from gelforge.recording.readings import AXES

NINETY = float(norm.ppf(0.95))


def values_of(fit: Refitted | Screened, name: str) -> tuple[Candidate, np.ndarray, np.ndarray]:
    """Return an effect of a fitted or judged set, its values (p,) and their covariance (p, p)."""
    k = [part.name for part in fit.parts].index(name)
    ends = np.cumsum([0, *(part.columns.shape[1] for part in fit.parts)])
    theta, entries = np.concatenate([np.atleast_1d(a) for a in fit.theta]), slice(ends[k], ends[k + 1])
    return fit.parts[k], theta[entries], fit.covariance[entries, entries]


def group_entries(judgement: Judgement) -> list[form.Group]:
    """Return the groups that a verdict reports, the most probable first; none where it has no answer."""
    if judgement.answer is None:
        return []
    if judgement.model is not None and judgement.model.sure and not judgement.model.with_effects:
        return []  # effects that are not sure were fitted without the cause that is
    groups = [one for one in judgement.answer.groups if one.chance >= NEGLIGIBLE]
    return sorted(groups, key=lambda group: -group.probability)


def effect_entries(problem: Problem, judgement: Judgement) -> list[form.NamedEffect]:
    """Return every effect that the readings can show: those of the answer first, then the most probable.

    What may stand in place of an effect of the answer has the values that it has with the others of the answer.
    """
    answer, posterior = judgement.answer, judgement.posterior
    groups = () if answer is None else answer.groups
    leading = {group.members[0] for group in groups}
    fits = {
        name: _of_set(judgement, frozenset({name})) or (one, one.log_bayes_factor)
        for name, one in posterior.singles.items()
    }
    if answer is not None:
        own = answer.fit.effects
        for group in groups:
            for name in group.names[1:]:
                fits[name] = _of_set(judgement, own - {group.members[0]} | {name}) or fits[name]
        fits |= {part.name: (answer.fit, posterior.evidence[own]) for part in answer.fit.parts}
    reported = [_effect(problem, name, *both, posterior.holding([name])) for name, both in fits.items()]
    return sorted(reported, key=lambda effect: (effect.name not in leading, -effect.probability))


def _of_set(judgement: Judgement, effects: frozenset[str]) -> tuple[Refitted | Screened, float] | None:
    """Return a set as it was fitted, or judged to first order, and its log evidence; None where it was neither."""
    answer, posterior = judgement.answer, judgement.posterior
    fit = None if answer is None else answer.refits.get(effects)
    if fit is not None:
        return fit, posterior.evidence.get(effects, fit.log_bayes_factor)
    judged = posterior.sets.get(effects)
    return None if judged is None else (judged, judged.log_bayes_factor)


def _effect(
    problem: Problem, name: str, fit: Refitted | Screened, log_bayes_factor: float, chance: float
) -> form.NamedEffect:
    part, theta, spread = values_of(fit, name)
    effect = problem.effect_of(part)
    return form.NamedEffect(
        name=name,
        family=effect.family,
        probability=chance,
        log_bayes_factor=float(log_bayes_factor),
        snr=float(np.linalg.norm(problem.covariance.whiten(part.columns @ theta))),
        parameters=value_entries(effect.parameters, theta, spread),
        hyperparameters=dict(part.hyperparameters),
        in_range=part.binary or effect.in_range(theta),
        refitted=isinstance(fit, Refitted),
    )


def value_entries(
    parameters: Sequence[Parameter], theta: np.ndarray, spread: np.ndarray
) -> list[form.ParameterEstimate]:
    """Return the values (p,) of an effect, of covariance (p, p), with their 90 % intervals."""
    sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
    return [
        form.ParameterEstimate(
            name=p.name, unit=p.unit, value=float(a), interval_90=interval(p, float(a), float(s))
        )
        for p, a, s in zip(parameters, theta, sd)
    ]


def interval(parameter: Parameter, a: float, sd: float) -> tuple[float, float]:
    """Return the 90 % interval of a value, within its physical range."""
    return tuple(np.clip([a - NINETY * sd, a + NINETY * sd], *parameter.bounds).tolist())


def verdict_of(
    problem: Problem,
    judgement: Judgement,
    title: str,
    synthetic: bool,
    sensor: Sensor | None,
    provenance: form.Provenance,
    flow: form.Flow | None = None,
) -> form.Verdict:
    """Return the verdict of a judgement."""
    answer, mismatch, posterior = judgement.answer, judgement.mismatch, judgement.posterior
    groups = group_entries(judgement)
    unknown = adequacy = None
    if answer is not None:
        chance, left = posterior.holding([UNKNOWN]), answer.adequacy
        unknown = (
            form.Unknown(probability=chance, words=posterior.discrepancy_words) if posterior.unknown else None
        )
        adequacy = form.Adequacy(p=left.test.p, scan_p=left.scan.p, remains=left.scan.best.name)
    asked = {key: getattr(mismatch, key) for key in ("unknown_p", "known_p") if posterior.unknown}
    return form.Verdict(
        title=title,
        synthetic=synthetic,
        state=judgement.state,
        sentence=sentence_of(problem, judgement),
        mismatch=form.Mismatch(**vars(mismatch.test), scan_p=mismatch.scan.p, **asked),
        where=[
            *(_where(mismatch) if mismatch.p < ALARM_P else []),
            *(located(judgement.answered, sensor) if groups else []),
        ],
        answer=groups,
        effects=effect_entries(problem, judgement),
        unknown=unknown,
        null_probability=posterior.probability[NOTHING],
        fit=_fit(problem, judgement).model_copy(update={"flow": flow}),
        adequacy=adequacy,
        model=model_section(problem, judgement),
        detection_limits=limits_of(problem),
        noise=_noise(problem.in_newtons),
        next_experiments=[
            form.Experiment(words=one.decided_by, separates=one.names) for one in groups if one.decided_by
        ],
        cannot_know=[*problem.observations.cannot_know, *judgement.notes, *shortcomings(problem, judgement)],
        outliers=list(problem.observations.set_aside),
        sensor=_shape(sensor),
        provenance=provenance,
    )


def readings_table(problem: Problem, judgement: Judgement) -> pd.DataFrame:
    """Return the rows of readings.csv, which has the forces alone."""
    forces = problem.in_newtons
    labels, observations = forces.labels, forces.observations
    held = np.full(len(labels), "no", dtype=object)
    for name, mask in judgement.blocks.held.items():
        held[mask[problem.of_force]] = name
    measured, nothing = observations.flat(observations.force), np.full(len(labels), np.nan)
    rest, unseen = rest_of(problem, judgement), unseen_of(problem, judgement)
    return labels[["session", "press", "x_mm", "y_mm", "depth_mm", "phase", "time_s"]].assign(
        site=labels["site"].astype(str),
        axis=np.array(AXES)[labels["axis"]],
        measured_N=measured,
        base_N=observations.flat(forces.base),
        after_N=nothing if rest is None else measured - rest,
        predicted_N=nothing if unseen is None else measured - unseen,
        sigma_N=forces.covariance.standard_deviation,
        held_out=held,
    )


def rest_of(problem: Problem, judgement: Judgement) -> np.ndarray | None:
    """Return measured less answer and model [N] of the forces, fitted to all readings; None where there is neither."""
    answer, model = judgement.answer, judgement.model
    if model is not None:
        return model.rest[problem.of_force]
    observations = problem.observations
    if answer is None:
        return None
    return observations.flat(observations.force - answer.after)[problem.of_force]


def unseen_of(problem: Problem, judgement: Judgement) -> np.ndarray | None:
    """Return measured less the prediction [N] of the forces by the training readings alone; None where there is none."""
    answer, model = judgement.answer, judgement.model
    if model is not None:
        return model.left[problem.of_force]
    if answer is None or answer.proof is None:
        return None
    return answer.proof.left[problem.of_force]


def _where(mismatch: ResidualTests) -> list[form.Where]:
    """Return the strongest pattern of each kind."""
    strongest: dict = {}
    for finding in mismatch.scan.ranked:
        strongest.setdefault(finding.kind, finding)
    places: list[form.Where] = []
    for finding in [*strongest.values()][:3]:
        # wider ones have no place
        region = finding.region if finding.region.get("radius_mm", 0.0) <= 5.0 else {}
        axis = f"force {region['axis']}" if "axis" in region else "force"
        said = {"channel": axis, "p": None if places else mismatch.scan.p, "snr": finding.snr, **region}
        known = {key: value for key, value in said.items() if key in form.Where.model_fields}
        places.append(form.Where(words=finding.name, **known))
    return places


def located(answer: Answer, sensor: Sensor | None) -> list[form.Where]:
    """Return where the answer's defects lie in the sensor: balls in a layer, discs on the lower face of the skin."""
    places, shape = [], _shape(sensor)
    for part in answer.fit.parts:
        if "z_mm" not in part.hyperparameters:
            continue
        x, y, z, radius = (float(part.hyperparameters[key]) for key in ("x_mm", "y_mm", "z_mm", "radius_mm"))
        half = 0.0 if part.name == "delamination" else radius
        layers = [] if shape is None else shape.layers
        places.append(
            form.Where(
                words=f"{part.name.replace('_', ' ')} at ({x:.4g}, {y:.4g}) mm, {-z:.3g} mm below the surface",
                x_mm=x,
                y_mm=y,
                radius_mm=radius,
                layer=next((one.name for one in layers if one.z_mm[0] <= z < one.z_mm[1]), None),
                depth_mm=(max(-z - half, 0.0), -z + half),
            )
        )
    return places


def _fit(problem: Problem, judgement: Judgement) -> form.Fit:
    answer, model = judgement.answer, judgement.model
    rest = rest_of(problem, judgement)
    held, blocks = None, []
    if model is not None and not model.with_effects:
        held = model.held  # effects fitted without it are not in `after`
    elif answer is not None and answer.proof is not None:
        held, *blocks = answer.proof.held
    return form.Fit(
        before=score(problem.in_newtons.labels, problem.in_newtons.residual),
        after=None if rest is None else score(problem.in_newtons.labels, rest),
        held_out=held,
        held_out_blocks=[*blocks, *(() if answer is None else answer.folds)],
    )


def limits_of(problem: Problem) -> list[form.DetectionLimit]:
    """Return the smallest value of each effect that the readings would show."""
    limits = []
    for part, k, value in detection_limits(problem.covariance, problem.physics):
        parameter = problem.effect_of(part).parameters[k]
        limits.append(
            form.DetectionLimit(
                effect=part.name,
                parameter=parameter.name,
                unit=parameter.unit,
                value=value if np.isfinite(value) else None,
                plausible=parameter.width,
            )
        )
    return limits


def _noise(problem: Problem) -> form.Noise:
    observations, labels = problem.observations, problem.labels
    floor, laws = _shared_errors(problem.covariance)
    return form.Noise(
        stated_N=by_axis(labels, observations.flat(observations.noise_N)),
        zero_N=by_axis(labels, observations.flat(observations.zero_N)),
        press_depth_mm=float(np.sqrt(np.mean(observations.press_depth_mm**2))),
        session_depth_mm=float(np.sqrt(np.mean(observations.session_depth_mm**2))),
        floor_N=by_axis(labels, floor),
        law_N=by_axis(labels, laws),
    )


def _shared_errors(covariance: Covariance) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviations (n,) [N] that the discretisation and the laws bring to each entry.

    Directions that all entries share are those of the laws, then half of the floor, then what each session has of its
    own (readings_covariance).
    """
    levels, none = covariance.levels, np.zeros(len(covariance))
    if len(levels) < 3:
        return none, none
    floor, common = levels[-2].directions, levels[-1].directions
    # as many columns as there are before the floor's
    laws = int(np.argmax((common == floor[:, :1]).all(axis=0)))
    return np.sqrt(2 * (floor**2).sum(axis=1)), np.sqrt((common[:, :laws] ** 2).sum(axis=1))


def _shape(sensor: Sensor | None) -> form.SensorShape | None:
    if sensor is None:
        return None
    faces = np.cumsum([-sensor.height_mm, *(layer.thickness_mm for layer in sensor.layers)]).tolist()
    layers = [
        form.Layer(name=one.name, z_mm=faces_of)
        for one, faces_of in zip(sensor.layers, zip(faces, faces[1:]))
    ]
    return form.SensorShape(width_x_mm=sensor.width_x_mm, width_y_mm=sensor.width_y_mm, layers=layers)


def taken_over(judgement: Judgement) -> bool:
    """Return whether the leading explanation may be put into the study: it has physical values and leaves only noise."""
    return judgement.state in ("identified", "ambiguous", "inconclusive") and judgement.explained
