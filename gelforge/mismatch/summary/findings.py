"""A judgement put into the form and the words of verdict.json and its tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np
import pandas as pd

from gelforge.config import Sensor
from gelforge.mismatch.evidence.covariance import Covariance
from gelforge.mismatch.evidence.identifiability import detection_limits
from gelforge.mismatch.goodness.residual_tests import ResidualTests
from gelforge.mismatch.images.flow import force_part
from gelforge.mismatch.inference.answer import Answer
from gelforge.mismatch.inference.judge import Judgement
from gelforge.mismatch.inference.proof import Proof
from gelforge.mismatch.result import verdict as form
from gelforge.mismatch.summary.effect_entries import effect_entries, group_entries, of_nothing, unknown_entry
from gelforge.mismatch.summary.model_section import model_section
from gelforge.mismatch.summary.words import (
    experiments_in_words,
    left_over,
    plain,
    sentence_of,
    uncomputed,
    unfinished,
)
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
    noise_cases: Sequence[form.NoiseCase] = (),
    flow: form.Flow | None = None,
) -> form.Verdict:
    """Return the verdict of a judgement."""
    answer = judgement.answer
    in_newtons = force_part(problem, judgement)
    groups = group_entries(problem, judgement)
    return form.Verdict(
        title=title,
        synthetic=synthetic,
        state=judgement.state,
        sentence=sentence_of(problem, judgement),
        mismatch=form.Mismatch(
            chi2=judgement.mismatch.test.chi2,
            degrees=judgement.mismatch.test.degrees,
            p=judgement.mismatch.test.p,
            scan_p=judgement.mismatch.scan.p,
            unknown_p=judgement.mismatch.unknown_p,
            known_p=judgement.mismatch.known_p,
        ),
        where=[
            *(_where(judgement.mismatch) if judgement.mismatch.p < form.ALARM_P else []),
            *(located(judgement.answered, sensor) if groups else []),
        ],
        answer=groups,
        effects=effect_entries(problem, judgement),
        unknown=unknown_entry(judgement),
        null_probability=of_nothing(judgement),
        fit=_fit(*in_newtons).model_copy(update={"flow": flow}),
        adequacy=None if answer is None else _adequacy(judgement),
        model=model_section(*in_newtons),
        detection_limits=limits_of(problem),
        noise=_noise(in_newtons[0], noise_cases),
        next_experiments=experiments_in_words(groups),
        cannot_know=[
            *problem.observations.cannot_know,
            *judgement.notes,
            *left_over(judgement),
            *unfinished(answer),
            *uncomputed(problem),
        ],
        outliers=[form.Outlier(**asdict(reading)) for reading in problem.observations.set_aside],
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
    kinds: set[str] = set()
    found: list[form.Where] = []
    for finding in mismatch.scan.ranked:
        if finding.kind in kinds or len(found) == PLACES:
            continue
        kinds.add(finding.kind)
        region = finding.region if finding.region.get("radius_mm", 0.0) <= LOCAL_MM else {}
        found.append(
            form.Where(
                words=finding.name,
                channel=f"force {region['axis']}" if "axis" in region else region.get("channel", "force"),
                x_mm=region.get("x_mm"),
                y_mm=region.get("y_mm"),
                radius_mm=region.get("radius_mm"),
                depth_mm=tuple(region["depth_mm"]) if "depth_mm" in region else None,
                time_s=tuple(region["time_s"]) if "time_s" in region else None,
                snr=finding.snr,
                p=mismatch.scan.p if not found else None,
            )
        )
    return found


def located(answer: Answer, sensor: Sensor | None) -> list[form.Where]:
    """Return where the answer's defects lie in the sensor: balls in a layer, discs on the lower face of the skin."""
    found = []
    for part in answer.fit.parts:
        if "z_mm" not in part.shape:
            continue
        x, y, z, radius = (float(part.shape[key]) for key in ("x_mm", "y_mm", "z_mm", "radius_mm"))
        half = 0.0 if part.name == "delamination" else radius
        layer = next((one.name for one in _layers(sensor) if one.z_mm[0] <= z < one.z_mm[1]), None)
        found.append(
            form.Where(
                words=f"{part.name.replace('_', ' ')} at ({x:.4g}, {y:.4g}) mm, {-z:.3g} mm below the surface",
                x_mm=x,
                y_mm=y,
                radius_mm=radius,
                layer=layer,
                depth_mm=(max(-z - half, 0.0), -z + half),
            )
        )
    return found


def _fit(problem: Problem, judgement: Judgement) -> form.Fit:
    answer, model = judgement.answer, judgement.model
    everything = np.ones(len(problem.labels), bool)
    before, rest = score_of(problem, problem.residual, everything), rest_of(problem, judgement)
    after = None if rest is None else score_of(problem, rest, everything)
    held, blocks = None, []
    if model is not None and not model.beside:
        section = model_section(problem, judgement)  # effects fitted without it are not in `after`
        held = None if section is None else section.held_out
    elif answer is not None and answer.proof is not None:
        held = _held_out(problem, "all", answer.proof).model_copy(
            update={"selection_penalty": answer.proof.gain.selection_penalty}
        )
        for name, mask in judgement.blocks.held.items():
            if mask.any():
                blocks.append(_held_out(problem, name, answer.proof, mask))
    if answer is not None:
        blocks += [_held_out(problem, name, proof) for name, proof in answer.folds.items()]
    return form.Fit(before=before, after=after, held_out=held, held_out_blocks=blocks)


def _held_out(problem: Problem, name: str, proof: Proof, mask: np.ndarray | None = None) -> form.HeldOut:
    """Return how base and answer predict what was held out, or one block of it, entries (n,) bool."""
    scores, gained = proof.scores, proof.gain
    if mask is None:
        mask = proof.blocks.held_out
    else:
        scores = {key: table[table["block"] == name] for key, table in scores.items()}
        gained = gain(scores["before"], scores["after"])
    return form.HeldOut(
        block=name,
        before=form.score(problem.labels, problem.residual, mask, scores["before"]["score"].sum()),
        after=form.score(problem.labels, proof.left, mask, scores["after"]["score"].sum()),
        gain=gained.total,
        standard_error=gained.standard_error,
    )


def score_of(problem: Problem, left: np.ndarray, mask: np.ndarray) -> form.Score:
    """Return how well a prediction with residual (n,) meets the entries (n,) bool."""
    density = problem.covariance.restricted(mask).log_density(left[mask])
    return form.score(problem.labels, left, mask, density)


def _adequacy(judgement: Judgement) -> form.Adequacy:
    adequacy = judgement.answered.adequacy
    return form.Adequacy(p=adequacy.test.p, scan_p=adequacy.scan.p, remains=plain(adequacy.scan.best))


def limits_of(problem: Problem) -> list[form.DetectionLimit]:
    """Return the smallest value of each effect that the readings would show."""
    found = []
    for limit in detection_limits(problem.covariance, problem.physics):
        parameter = problem.effects[limit.name].parameters[limit.parameter]
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


def _noise(problem: Problem, cases: Sequence[form.NoiseCase]) -> form.Noise:
    observations, labels = problem.observations, problem.labels
    floor, laws = _shared_errors(problem.covariance)
    axis = labels["axis"].to_numpy()

    def by_axis(values: np.ndarray) -> list[float | None]:
        return [
            float(np.sqrt(np.mean(values[axis == k] ** 2))) if (axis == k).any() else None for k in range(3)
        ]

    return form.Noise(
        stated_N=by_axis(observations.flat(observations.noise_N)),
        zero_N=by_axis(observations.flat(observations.zero_N)),
        contact_point_scatter_mm=float(
            np.sqrt(np.mean(observations.press_depth_mm**2 + observations.session_depth_mm**2))
        ),
        press_depth_mm=float(np.sqrt(np.mean(observations.press_depth_mm**2))),
        session_depth_mm=float(np.sqrt(np.mean(observations.session_depth_mm**2))),
        floor_N=by_axis(floor),
        law_N=by_axis(laws),
        sensitivity=list(cases),
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
    laws = int(
        np.argmax((common == floor[:, :1]).all(axis=0))
    )  # as many columns as there are before the floor's
    return np.sqrt(2 * (floor**2).sum(axis=1)), np.sqrt((common[:, :laws] ** 2).sum(axis=1))


def _shape(sensor: Sensor | None) -> form.SensorShape | None:
    if sensor is None:
        return None
    prior_sd = {"width_x_mm": sensor.width_x_mm, "width_y_mm": sensor.width_y_mm}
    return form.SensorShape(**prior_sd, layers=_layers(sensor))


def _layers(sensor: Sensor | None) -> list[form.Layer]:
    layers, z = [], 0.0 if sensor is None else -sensor.height_mm
    for layer in () if sensor is None else sensor.layers:
        layers.append(form.Layer(name=layer.name, z_mm=(z, z + layer.thickness_mm)))
        z += layer.thickness_mm
    return layers


def taken_over(judgement: Judgement) -> bool:
    """Return whether the leading explanation may be put into the study: it has physical values and leaves only noise."""
    return judgement.state in ("identified", "ambiguous", "inconclusive") and judgement.explained
