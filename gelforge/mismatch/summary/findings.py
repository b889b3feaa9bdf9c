"""A judgement put into the form of verdict.json and its tables."""

from __future__ import annotations

import numpy as np
import pandas as pd

from gelforge.config import Sensor
from gelforge.mismatch.evidence.alternatives import NOTHING, UNKNOWN
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.identifiability import detection_limits
from gelforge.mismatch.goodness.residual_tests import ResidualTests
from gelforge.mismatch.images.flow import force_part
from gelforge.mismatch.inference.answer import Answer
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.inference.proof import Proof
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.summary.effect_entries import effect_entries, group_entries
from gelforge.mismatch.summary.model_section import model_section
from gelforge.mismatch.summary.words import sentence_of, shortcomings
from gelforge.mismatch.terms.holdout import gain
from gelforge.mismatch.terms.problem import Problem
from gelforge.recording.readings import AXES

LOCAL_MM = 5.0  # a pattern wider than this has no place of its own
PLACES = 3  # patterns of the scan that are reported


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
    in_newtons = force_part(problem, judgement)
    groups = group_entries(problem, judgement)
    unknown = adequacy = None
    if answer is not None:
        chance, left = posterior.holding([UNKNOWN]), answer.adequacy
        unknown = (
            form.Unknown(probability=chance, words=answer.discrepancy_words) if posterior.unknown else None
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
            *(_where(mismatch) if mismatch.p < form.ALARM_P else []),
            *(located(judgement.answered, sensor) if groups else []),
        ],
        answer=groups,
        effects=effect_entries(problem, judgement),
        unknown=unknown,
        null_probability=posterior.probability[NOTHING],
        fit=_fit(*in_newtons).model_copy(update={"flow": flow}),
        adequacy=adequacy,
        model=model_section(*in_newtons),
        detection_limits=limits_of(problem),
        noise=_noise(in_newtons[0]),
        next_experiments=[
            form.Experiment(words=one.decided_by, separates=one.names) for one in groups if one.decided_by
        ],
        cannot_know=[*problem.observations.cannot_know, *judgement.notes, *shortcomings(problem, judgement)],
        outliers=list(problem.observations.set_aside),
        sensor=_shape(sensor),
        provenance=provenance,
    )


def readings_table(problem: Problem, judgement: Judgement) -> pd.DataFrame:
    """Return the rows of readings.csv."""
    labels, observations = problem.labels, problem.observations
    held = np.full(len(labels), "no", dtype=object)
    for name, mask in judgement.blocks.held.items():
        held[mask] = name
    measured, nothing = observations.flat(observations.force), np.full(len(labels), np.nan)
    rest, unseen = rest_of(problem, judgement), unseen_of(judgement)
    return labels[["session", "press", "x_mm", "y_mm", "depth_mm", "phase", "time_s"]].assign(
        site=labels["site"].astype(str),
        axis=np.array(AXES)[labels["axis"]],
        measured_N=measured,
        base_N=observations.flat(problem.base),
        after_N=nothing if rest is None else measured - rest,
        predicted_N=nothing if unseen is None else measured - unseen,
        sigma_N=problem.covariance.standard_deviation,
        held_out=held,
    )


def rest_of(problem: Problem, judgement: Judgement) -> np.ndarray | None:
    """Return measured less answer and model (n,) [N], fitted to all readings; None where there is neither."""
    answer, model = judgement.answer, judgement.model
    if model is not None:
        return model.rest
    observations = problem.observations
    return None if answer is None else observations.flat(observations.force - answer.after)


def unseen_of(judgement: Judgement) -> np.ndarray | None:
    """Return measured less the prediction (n,) [N] by what the training readings alone say; None where there is none."""
    answer, model = judgement.answer, judgement.model
    if model is not None:
        return model.left
    return None if answer is None or answer.proof is None else answer.proof.left


def _where(mismatch: ResidualTests) -> list[form.Where]:
    """Return the strongest pattern of each kind."""
    strongest: dict = {}
    for finding in mismatch.scan.ranked:
        strongest.setdefault(finding.kind, finding)
    found: list[form.Where] = []
    for finding in [*strongest.values()][:PLACES]:
        region = finding.region if finding.region.get("radius_mm", 0.0) <= LOCAL_MM else {}
        axis = f"force {region['axis']}" if "axis" in region else "force"
        said = {"channel": axis, "p": None if found else mismatch.scan.p, "snr": finding.snr, **region}
        known = {key: value for key, value in said.items() if key in form.Where.model_fields}
        found.append(form.Where(words=finding.name, **known))
    return found


def located(answer: Answer, sensor: Sensor | None) -> list[form.Where]:
    """Return where the answer's defects lie in the sensor: balls in a layer, discs on the lower face of the skin."""
    found, shape = [], _shape(sensor)
    for part in answer.fit.parts:
        if "z_mm" not in part.shape:
            continue
        x, y, z, radius = (float(part.shape[key]) for key in ("x_mm", "y_mm", "z_mm", "radius_mm"))
        half = 0.0 if part.name == "delamination" else radius
        layers = [] if shape is None else shape.layers
        found.append(
            form.Where(
                words=f"{part.name.replace('_', ' ')} at ({x:.4g}, {y:.4g}) mm, {-z:.3g} mm below the surface",
                x_mm=x,
                y_mm=y,
                radius_mm=radius,
                layer=next((one.name for one in layers if one.z_mm[0] <= z < one.z_mm[1]), None),
                depth_mm=(max(-z - half, 0.0), -z + half),
            )
        )
    return found


def _fit(problem: Problem, judgement: Judgement) -> form.Fit:
    answer, model = judgement.answer, judgement.model
    rest = rest_of(problem, judgement)
    held, blocks = None, []
    if model is not None and not model.beside:
        section = model_section(problem, judgement)  # effects fitted without it are not in `after`
        held = None if section is None else section.held_out
    elif answer is not None and answer.proof is not None:
        held = _held_out(problem, "all", answer.proof)
        for name, mask in judgement.blocks.held.items():
            if mask.any():
                blocks.append(_held_out(problem, name, answer.proof, mask))
    if answer is not None:
        blocks += [_held_out(problem, name, proof) for name, proof in answer.folds.items()]
    return form.Fit(
        before=form.score(problem.labels, problem.residual),
        after=None if rest is None else form.score(problem.labels, rest),
        held_out=held,
        held_out_blocks=blocks,
    )


def _held_out(problem: Problem, name: str, proof: Proof, mask: np.ndarray | None = None) -> form.HeldOut:
    """Return how base and answer predict what was held out, or one block of it, entries (n,) bool."""
    gained = proof.gain
    if mask is not None:
        before, after = (proof.scores[key] for key in ("before", "after"))
        gained = gain(before[before["block"] == name], after[after["block"] == name])
    mask = proof.blocks.held_out if mask is None else mask
    return form.HeldOut(
        block=name,
        before=form.score(problem.labels, problem.residual, mask),
        after=form.score(problem.labels, proof.left, mask),
        gain=gained.total,
        standard_error=gained.standard_error,
        selection_penalty=gained.selection_penalty,
    )


def limits_of(problem: Problem) -> list[form.DetectionLimit]:
    """Return the smallest value of each effect that the readings would show."""
    found = []
    for limit in detection_limits(problem.covariance, problem.physics):
        parameter = problem.effect_of(limit).parameters[limit.parameter]
        found.append(
            form.DetectionLimit(
                effect=limit.name,
                parameter=parameter.name,
                unit=parameter.unit,
                amount=limit.amount if np.isfinite(limit.amount) else None,
                plausible=parameter.width,
            )
        )
    return found


def _noise(problem: Problem) -> form.Noise:
    observations, labels = problem.observations, problem.labels
    floor, laws = _shared_errors(problem.covariance)
    return form.Noise(
        stated_N=form.by_axis(labels, observations.flat(observations.noise_N)),
        zero_N=form.by_axis(labels, observations.flat(observations.zero_N)),
        press_depth_mm=float(np.sqrt(np.mean(observations.press_depth_mm**2))),
        session_depth_mm=float(np.sqrt(np.mean(observations.session_depth_mm**2))),
        floor_N=form.by_axis(labels, floor),
        law_N=form.by_axis(labels, laws),
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
