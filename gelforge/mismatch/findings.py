"""A judgement put into the form and the words of verdict.json and its tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib.metadata import version

import numpy as np
import pandas as pd

from gelforge.config import Sensor, Study
from gelforge.mismatch import verdict as form
from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.effects_told import effects_told, groups_told, of_nothing, unknown_told
from gelforge.mismatch.flow import force_part
from gelforge.mismatch.holdout import gain, predictive_scores
from gelforge.mismatch.identifiability import detection_limits
from gelforge.mismatch.judge import Judgement, in_range
from gelforge.mismatch.law_search import Terms, search, terms
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.remains import Remains
from gelforge.mismatch.search import Answer
from gelforge.mismatch.words import (
    experiments_in_words,
    left_over,
    plain,
    sentence_of,
    uncomputed,
    unfinished,
)
from gelforge.recording.readings import AXES

LOCAL_MM = 5.0  # a pattern wider than this has no place of its own
PLACES = 3  # patterns of the scan that are told


def verdict_of(
    problem: Problem,
    judgement: Judgement,
    title: str,
    synthetic: bool,
    sensor: Sensor | None,
    provenance: form.Provenance,
    noise_cases: Sequence[form.NoiseCase] = (),
    law: form.Law | None = None,
    flow: form.Flow | None = None,
) -> form.Verdict:
    """Return the verdict of a judgement."""
    answer = judgement.answer
    in_newtons = force_part(problem, judgement)
    told = groups_told(problem, judgement.told)
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
            *(_where(judgement.mismatch) if answer or judgement.state == "open" else []),
            *(located(answer, sensor, told) if told else []),
        ],
        answer=told,
        effects=effects_told(problem, judgement),
        unknown=unknown_told(judgement),
        null_probability=of_nothing(judgement),
        fit=_fit(*in_newtons).model_copy(update={"flow": flow}),
        adequacy=None if answer is None else _adequacy(judgement),
        law=law,
        detection_limits=_limits(problem, judgement),
        noise=_noise(in_newtons[0], noise_cases),
        next_experiments=experiments_in_words(problem, judgement),
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
    after = predicted = np.full(len(labels), np.nan)
    if judgement.answer is not None:
        after = observations.flat(judgement.answer.final.after)
        predicted = observations.flat(judgement.answer.after)
    return labels[["session", "press", "x_mm", "y_mm", "depth_mm", "phase", "time_s"]].assign(
        site=labels["site"].astype(str),
        axis=np.array(AXES)[labels["axis"]],
        measured_N=observations.flat(observations.force),
        base_N=observations.flat(problem.base),
        after_N=after,
        predicted_N=predicted,
        sigma_N=problem.covariance.standard_deviation,
        held_out=held,
    )


def law_of(problem: Problem, judgement: Judgement, study: Study) -> form.Law | None:
    """Return a law for what the best answer leaves, found on the training readings alone; None where none predicts."""
    train, answer = judgement.blocks.train, judgement.answer
    labels, observations = problem.labels, problem.observations
    if judgement.state != "open" or labels["site"][train].nunique() < 2:
        return None
    left = observations.flat(observations.force - (problem.base if answer is None else answer.after))
    sensor = study.sensor
    radius = min(part.radius_mm for part in study.indenter.shapes)
    widths = sensor.width_x_mm, sensor.width_y_mm
    candidates = terms(labels, observations.flat(problem.base), radius, sensor.height_mm, widths)
    covariance = problem.covariance.restricted(train)
    on_train = Terms(candidates.names, candidates.values[train])
    law = search(left[train], covariance, on_train, labels[train].reset_index(drop=True), study.seed)
    if not law.terms:
        return None
    columns = candidates.values[:, [candidates.names.index(name) for name in law.terms]]
    after = left - columns @ np.array(law.coefficients)
    spread = np.diag(np.square(law.standard_deviations))
    scores = [
        predictive_scores(left, problem.covariance, judgement.blocks, labels),
        predictive_scores(after, problem.covariance, judgement.blocks, labels, columns, spread),
    ]
    tables = {"before": scores[0], "after": scores[1]}
    held = _held_out(problem, "all", left, after, judgement.blocks.held_out, tables)
    return form.Law(words=law.text, terms=dict(zip(law.terms, law.coefficients)), held_out=held)


def _where(mismatch: Remains) -> list[form.Where]:
    kinds, found = set(), []
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


def located(answer: Answer, sensor: Sensor | None, told: Sequence[form.Group]) -> list[form.Where]:
    """Return where the defects that are told lie in the sensor: balls in a layer, discs on the lower face of the skin."""
    names, found = {name for group in told for name in group.members}, []
    for part in answer.final.fit.parts:
        if "z_mm" not in part.shape or part.name not in names:
            continue
        x, y, z, radius = (part.shape[key] for key in ("x_mm", "y_mm", "z_mm", "radius_mm"))
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
    observations, answer = problem.observations, judgement.answer
    everything = np.ones(len(problem.labels), bool)
    before = score_of(problem, problem.residual, everything)
    if answer is None:
        return form.Fit(before=before)
    left = observations.flat(observations.force - answer.after)
    held, blocks = None, []
    if answer.gain is not None:
        everything_held = judgement.blocks.held_out
        held = _held_out(problem, "all", problem.residual, left, everything_held, answer.scores)
        held = held.model_copy(update={"paid": answer.gain.paid})
        for name, mask in judgement.blocks.held.items():
            own = {key: table[table["block"] == name] for key, table in answer.scores.items()}
            if mask.any():
                blocks.append(_held_out(problem, name, problem.residual, left, mask, own))
    for name, (split, residual, _, scores) in answer.folds.items():
        blocks.append(_held_out(problem, name, problem.residual, residual, split.held_out, scores))
    told = observations.flat(observations.force - answer.final.after)
    after = score_of(problem, told, everything)
    return form.Fit(before=before, after=after, held_out=held, held_out_blocks=blocks)


def _held_out(
    problem: Problem,
    name: str,
    before: np.ndarray,
    after: np.ndarray,
    mask: np.ndarray,
    scores: Mapping[str, pd.DataFrame],
) -> form.HeldOut:
    """Return how residuals (n,) before and after meet the entries (n,) bool of a block, with their predictive scores."""
    gained = gain(scores["before"], scores["after"])
    return form.HeldOut(
        block=name,
        before=_predicted(problem, before, mask, scores["before"]["score"].sum()),
        after=_predicted(problem, after, mask, scores["after"]["score"].sum()),
        gain=gained.total,
        standard_error=gained.standard_error,
    )


def score_of(problem: Problem, left: np.ndarray, mask: np.ndarray) -> form.Score:
    """Return how well a prediction with residual (n,) meets the entries (n,) bool."""
    density = problem.covariance.restricted(mask).log_density(left[mask])
    return _predicted(problem, left, mask, density)


def _predicted(problem: Problem, left: np.ndarray, mask: np.ndarray, density: float) -> form.Score:
    axis = problem.labels["axis"].to_numpy()
    rmse = [
        float(np.sqrt(np.mean(left[mask & (axis == k)] ** 2))) if (mask & (axis == k)).any() else None
        for k in range(3)
    ]
    return form.Score(readings=int(mask.sum()), rmse_N=rmse, log_score=float(density))


def _adequacy(judgement: Judgement) -> form.Adequacy:
    adequacy, everywhere = judgement.answer.adequacy, judgement.answer.everywhere
    return form.Adequacy(
        p=adequacy.test.p,
        scan_p=adequacy.scan.p,
        remains=plain(adequacy.scan.best),
        everywhere_p=everywhere.p,
        refuted=judgement.refuted,
    )


def _limits(problem: Problem, judgement: Judgement) -> list[form.DetectionLimit]:
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
        touchdown_mm=float(
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
    widths = {"width_x_mm": sensor.width_x_mm, "width_y_mm": sensor.width_y_mm}
    return form.SensorShape(**widths, layers=_layers(sensor))


def _layers(sensor: Sensor | None) -> list[form.Layer]:
    layers, z = [], 0.0 if sensor is None else -sensor.height_mm
    for layer in () if sensor is None else sensor.layers:
        layers.append(form.Layer(name=layer.name, z_mm=(z, z + layer.thickness_mm)))
        z += layer.thickness_mm
    return layers


def versions() -> dict[str, str]:
    """Return the versions that decide the numbers."""
    return {name: version(name) for name in ("gelforge", "numpy", "scipy", "pandas")}


def confirmed(judgement: Judgement, problem: Problem) -> bool:
    """Return whether the answer may be put into the study."""
    return judgement.state in ("named", "group") and in_range(problem, judgement.answer.final.fit)
