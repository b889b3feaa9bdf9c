"""A judgement put into the form and the words of verdict.json and its tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pandas as pd
from scipy.stats import norm

from gelforge.config import Sensor, Study
from gelforge.mismatch import verdict as form
from gelforge.mismatch.alternatives import NOTHING
from gelforge.mismatch.covariance import Covariance
from gelforge.mismatch.flow import force_part
from gelforge.mismatch.holdout import gain, predictive_scores
from gelforge.mismatch.identifiability import detection_limits, profile
from gelforge.mismatch.judge import Judgement, in_range
from gelforge.mismatch.law_search import Terms, search, terms
from gelforge.mismatch.problem import Problem
from gelforge.mismatch.remains import Remains
from gelforge.mismatch.scan import Finding
from gelforge.mismatch.screen import Screened
from gelforge.mismatch.search import Answer

AXES = ("x", "y", "z")
NINETY = float(norm.ppf(0.95))
LOCAL_MM = 5.0  # a pattern wider than this has no place of its own
PROFILE_SD, PROFILE_POINTS = 4.0, 33
PLACES = 3  # patterns of the scan that are told
BODY_WIDTH = 0.3  # standard deviation of a patch's relative change of modulus before anything is known


def verdict_of(
    problem: Problem,
    judgement: Judgement,
    title: str,
    synthetic: bool,
    sensor: Sensor | None,
    provenance: form.Provenance,
    noise_cases: Sequence[form.NoiseCase] = (),
    experiments: Sequence[form.Experiment] = (),
    law: form.Law | None = None,
    flow: form.Flow | None = None,
) -> form.Verdict:
    """Return the verdict of a judgement."""
    answer = judgement.answer
    in_newtons = force_part(problem, judgement)
    told = _groups(problem, answer) if judgement.state in ("named", "group", "open") else []
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
        ),
        where=_where(judgement.mismatch) if answer or judgement.state == "open" else [],
        answer=told,
        effects=_effects(problem, judgement),
        null_probability=_of_nothing(judgement),
        fit=_fit(*in_newtons).model_copy(update={"flow": flow}),
        adequacy=None if answer is None else _adequacy(judgement),
        law=law,
        detection_limits=_limits(problem, judgement),
        noise=_noise(in_newtons[0], noise_cases),
        next_experiments=list(experiments) or _texts(problem, judgement),
        cannot_know=[
            *problem.observations.cannot_know,
            *judgement.notes,
            *_unfinished(answer),
            *_uncomputed(problem),
        ],
        outliers=[
            form.Outlier(session="", press=text, reason="set aside by the gate")
            for text in problem.observations.set_aside
        ],
        sensor=_shape(sensor),
        provenance=provenance,
    )


def readings_table(problem: Problem, judgement: Judgement) -> pd.DataFrame:
    """Return the rows of readings.csv."""
    labels, observations = problem.labels, problem.observations
    held = np.full(len(labels), "no", dtype=object)
    for name, mask in judgement.blocks.held.items():
        held[mask] = name
    after = (
        np.full(len(labels), np.nan)
        if judgement.answer is None
        else observations.flat(judgement.answer.after)
    )
    return labels[["session", "press", "x_mm", "y_mm", "depth_mm", "phase", "time_s"]].assign(
        site=labels["site"].astype(str),
        axis=np.array(AXES)[labels["axis"]],
        measured_N=observations.flat(observations.force),
        base_N=observations.flat(problem.base),
        after_N=after,
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
    candidates = terms(labels, observations.flat(problem.base), radius, sensor.height_mm, sensor.width_x_mm)
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


def body_map(problem: Problem, covariance: Covariance) -> pd.DataFrame | None:
    """Return the rows of body_map.csv: relative changes of the modulus of balls in the body that fit the residual best.

    Every ball has the prior N(0, BODY_WIDTH^2), by the linear changes of `inclusion`; None where they are not known.
    """
    balls = [candidate for candidate in problem.candidates if candidate.name == "inclusion"]
    if not balls:
        return None
    r = covariance.whiten(problem.residual)
    J = covariance.whiten(np.column_stack([ball.columns for ball in balls])) * BODY_WIDTH
    S = np.linalg.inv(np.eye(J.shape[1]) + J.T @ J)
    change, sigma = BODY_WIDTH * (S @ (J.T @ r)), BODY_WIDTH * np.sqrt(np.diag(S))
    places = pd.DataFrame([dict(ball.shape) for ball in balls])[["x_mm", "y_mm", "z_mm"]]
    return places.assign(change=change, sigma=sigma)


def sentence_of(problem: Problem, judgement: Judgement) -> str:
    """Return the verdict in one plain sentence."""
    state, mismatch = judgement.state, judgement.mismatch
    if state == "null":
        return (
            f"Simulation and readings agree within their errors (p = {mismatch.p:.2g}); no physics is missing that these "
            "readings could show."
        )
    if judgement.answer is None and state == "insufficient":
        return (
            f"Simulation and readings agree within their errors (p = {mismatch.p:.2g}), but these readings could not show "
            "plausible amounts of most effects."
        )
    where = f"Simulation and readings differ beyond their errors, most clearly {_plain(mismatch.scan.best)}"
    if judgement.answer is None:
        return f"{where}; no effect of the catalogue could be fitted."
    words = _answer_words(problem, judgement.answer, state != "insufficient")
    if state == "open" and judgement.answer.adequacy.p > form.ADEQUATE_P and judgement.refuted:
        everywhere = judgement.answer.everywhere
        most = f", most clearly {_plain(everywhere.scan.best)}" if everywhere.p <= form.ADEQUATE_P else ""
        return (
            f"{where}; no effect of the catalogue explains it: the best, {words}, fits the readings that it was fitted to, "
            f"but those set aside refute it{most}."
        )
    if state == "open":
        remaining = _plain(judgement.answer.adequacy.scan.best)
        return (
            f"{where}; no effect of the catalogue explains it: the best, {words}, leaves something, most clearly "
            f"{remaining}."
        )
    if state == "insufficient" and not judgement.answer.fit.converged:
        return (
            f"{where}; {words} would fit, but its fit in the solver has not come to rest: no name is given."
        )
    if state == "insufficient" and judgement.answer.gain is not None and judgement.answer.gain.clear:
        return (
            f"{where}; {words} would fit, but nothing is likely enough to be named: too few readings to say."
        )
    if state == "insufficient":
        return f"{where}; {words} would fit, but the readings set aside do not confirm it: too few to say."
    return f"{where}; it is explained by {words}."


def _answer_words(problem: Problem, answer: Answer, with_others: bool) -> str:
    found = []
    for part, amounts, group in zip(answer.fit.parts, answer.fit.amounts, _groups(problem, answer)):
        effect = problem.effects[part.name]
        values = " and ".join(
            f"{p.name} {a:.3g} {'' if p.unit == '1' else p.unit}".rstrip()
            for p, a in zip(effect.parameters, amounts)
        )
        own = part.name.replace("_", " ") + ("" if part.switch else f" ({values})")
        others = [name.replace("_", " ") for name in group.members if name != part.name and with_others]
        found.append(
            own + (f", or {', '.join(others)}, which these readings cannot tell from it" if others else "")
        )
    return " together with ".join(found)


def _plain(finding: Finding) -> str:
    """Return a pattern of the scan in words that follow "most clearly"."""
    name, _, kind = finding.name.rpartition(", ")  # the last comma: places hold one of their own
    before = {"depth": "", "position": "", "axis": "", "wave": "as a ", "phase": "as "}.get(finding.kind, "")
    if finding.kind == "depth" and name[0] == "d":
        before = "at "
    how = {"share of the force": " in proportion to the force"}.get(kind, f" as a {kind}" if kind else "")
    return f"{before}{name}{how}"


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


def _groups(problem: Problem, answer: Answer | None) -> list[form.Group]:
    if answer is None:
        return []
    found = []
    for group in answer.groups:
        cosines = [abs(c) for name, c in group.cosines.items() if name != group.members[0]]
        first = problem.effects[group.members[0].split(" + ")[-1]]
        found.append(
            form.Group(
                members=[name.split(" + ")[-1] for name in group.members],
                probability=min(group.probability, 1.0),
                odds=min(group.odds, 1e12) if len(group.members) > 1 else None,
                cosine=min(max(cosines), 1.0) if cosines else None,
                decided_by=first.separated_by if len(group.members) > 1 else "",
            )
        )
    return found


def _of_nothing(judgement: Judgement) -> float:
    """Return the probability that nothing is missing: by what the search found, or by the screen where none was made."""
    if judgement.state in ("named", "group", "open"):
        return 0.0
    if judgement.answer is None:
        return judgement.probability["null"]
    return judgement.answer.alternatives.probability[NOTHING]


def _effects(problem: Problem, judgement: Judgement) -> list[form.NamedEffect]:
    answer = judgement.answer
    found: dict[str, form.NamedEffect] = {}
    if answer is not None:
        for part, amounts, group, spread in zip(
            answer.fit.parts, answer.fit.amounts, answer.groups, _blocks(answer)
        ):
            found[part.name] = _effect(
                problem, part.name, dict(part.shape), amounts, spread,
                answer.alternatives.holding([part.name]), answer.winner.log_bayes_factor,
                answer.winner.snr, True, [name.split(" + ")[-1] for name in group.members], part.switch,
            )  # fmt: skip
        if len(answer.fit.parts) == 1 and not answer.fit.parts[0].switch:
            name = answer.fit.parts[0].name
            found[name] = _profiled(problem, judgement, found[name])
        names = [fit.parts[-1].name for fit in answer.refits]
        if len(answer.fit.parts) == 1:
            for judged in answer.ranked[1:]:
                chance = answer.alternatives.holding([judged.name])
                found[judged.name] = _screened(problem, judged, chance, judged.name in names)
    for judged in judgement.singles:
        if judged.name not in found:
            known = judgement.probability.get(judged.name, 0.0)
            chance = known if answer is None else answer.alternatives.holding([judged.name])
            found[judged.name] = _screened(problem, judged, chance, False)
    rank = {name: k for k, name in enumerate(found)}
    first = {part.name for part in answer.fit.parts} if answer is not None else set()
    return sorted(found.values(), key=lambda e: (e.name not in first, -e.probability, rank[e.name]))


def _profiled(problem: Problem, judgement: Judgement, effect: form.NamedEffect) -> form.NamedEffect:
    """Return the answer's effect with the profiles of its amounts, to first order about the refit, on training readings."""
    train, answer = judgement.blocks.train, judgement.answer
    residual = problem.residual[train]
    covariance = problem.believing(answer.fit.parts, answer.fit.amounts[0]).covariance.restricted(train)
    part = answer.fit.parts[0].restricted(train)
    judged = replace(answer.winner, parts=(part,))
    change = problem.observations.flat(answer.after - problem.base)[train]
    offset = (
        residual - change + part.columns @ answer.fit.amounts[0]
    )  # the model's own change at the fitted amounts
    amounts = []
    for k, (amount, sd) in enumerate(zip(effect.amounts, np.sqrt(np.diag(answer.fit.covariance)))):
        grid = amount.value + sd * np.linspace(-PROFILE_SD, PROFILE_SD, PROFILE_POINTS)
        values = profile(offset, covariance, judged, k, grid)
        amounts.append(amount.model_copy(update={"profile": list(zip(grid.tolist(), values.tolist()))}))
    return effect.model_copy(update={"amounts": amounts})


def _blocks(answer: Answer) -> list[np.ndarray]:
    """Return each part's own block of the amounts' covariance."""
    ends = np.cumsum([0, *(len(a) for a in answer.fit.amounts)])
    return [answer.fit.covariance[a:b, a:b] for a, b in zip(ends, ends[1:])]


def _screened(problem: Problem, judged: Screened, chance: float, refitted: bool) -> form.NamedEffect:
    last = judged.parts[-1]
    p = last.columns.shape[1]
    return _effect(
        problem, last.name, dict(last.shape), judged.amounts[-p:], judged.covariance[-p:, -p:], min(chance, 1.0),
        judged.log_bayes_factor, judged.snr, refitted, [], last.switch,
    )  # fmt: skip


def _effect(
    problem, name, shape, amounts, spread, chance, factor, snr, refitted, group, switch
) -> form.NamedEffect:
    effect = problem.effects[name]
    sd = np.sqrt(np.maximum(np.diag(spread), 0.0))
    told = [
        form.Amount(
            name=p.name,
            unit=p.unit,
            value=float(a),
            interval_90=(float(a - NINETY * s), float(a + NINETY * s)),
            bounds=p.bounds if np.isfinite(p.bounds).all() else None,
        )
        for p, a, s in zip(effect.parameters, amounts, sd)
    ]
    return form.NamedEffect(
        name=name,
        family=effect.family,
        probability=float(np.clip(chance, 0.0, 1.0)),
        log_bayes_factor=float(factor),
        snr=float(snr),
        amounts=told,
        shape=shape,
        in_range=switch or effect.in_range(amounts),
        refitted=refitted,
        group=group if len(group) > 1 else [],
    )


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
        for name, mask in judgement.blocks.held.items():
            own = {key: table[table["block"] == name] for key, table in answer.scores.items()}
            if mask.any():
                blocks.append(_held_out(problem, name, problem.residual, left, mask, own))
    for name, (split, residual, _, scores) in answer.folds.items():
        blocks.append(_held_out(problem, name, problem.residual, residual, split.held_out, scores))
    after = score_of(problem, left, everything)
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
        remains=_plain(adequacy.scan.best),
        everywhere_p=everywhere.p,
        refuted=judgement.refuted,
    )


def _limits(problem: Problem, judgement: Judgement) -> list[form.DetectionLimit]:
    found = []
    for limit in detection_limits(problem.covariance, problem.candidates):
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
        touchdown_mm=float(np.sqrt(np.mean(observations.touchdown_mm**2))),
        floor_N=by_axis(floor),
        law_N=by_axis(laws),
        sensitivity=list(cases),
    )


def _shared_errors(covariance: Covariance) -> tuple[np.ndarray, np.ndarray]:
    """Return the standard deviations (n,) [N] that the discretisation and the laws bring to each entry.

    Directions that all entries share are those of the laws, then half of the floor, then a column per session where depth
    zero is the session's (readings_covariance).
    """
    levels, none = covariance.levels, np.zeros(len(covariance))
    if len(levels) < 3:
        return none, none
    floor, common = levels[-2].directions, levels[-1].directions
    laws = int(
        np.argmax((common == floor[:, :1]).all(axis=0))
    )  # as many columns as there are before the floor's
    return np.sqrt(2 * (floor**2).sum(axis=1)), np.sqrt((common[:, :laws] ** 2).sum(axis=1))


def _texts(problem: Problem, judgement: Judgement) -> list[form.Experiment]:
    """Return the experiments that the effects' own files name for what cannot be told apart."""
    if judgement.answer is None:
        return []
    return [
        form.Experiment(words=group.decided_by, separates=group.members)
        for group in _groups(problem, judgement.answer)
        if group.decided_by
    ]


def _unfinished(answer: Answer | None) -> list[str]:
    """Return which refits were cut short: their amounts would still change by more than their intervals show."""
    fits = [] if answer is None else [fit for fit in answer.refits if not fit.converged]
    names = [fit.name.replace("_", " ") for fit in fits]
    if not names:
        return []
    text = (
        f"{', '.join(names)}: the fit was still moving after its last step, or the solver could not"
        " follow it; amounts and intervals are not final"
    )
    return [text + ("" if answer.fit.converged else ", and the answer rests on one of them: it is not named")]


def _uncomputed(problem: Problem) -> list[str]:
    by_reason: dict[str, list[str]] = {}
    for name, reason in problem.failed.items():
        by_reason.setdefault(reason, []).append(name)
    return [f"{', '.join(names)} could not be tried: {reason}" for reason, names in by_reason.items()]


def _shape(sensor: Sensor | None) -> form.SensorShape | None:
    if sensor is None:
        return None
    layers, z = [], -sensor.height_mm
    for layer in sensor.layers:
        layers.append(form.Layer(name=layer.name, z_mm=(z, z + layer.thickness_mm)))
        z += layer.thickness_mm
    return form.SensorShape(width_x_mm=sensor.width_x_mm, width_y_mm=sensor.width_y_mm, layers=layers)


def versions() -> dict[str, str]:
    """Return the versions that decide the numbers."""
    return {name: version(name) for name in ("gelforge", "numpy", "scipy", "pandas")}


def confirmed(judgement: Judgement, problem: Problem) -> bool:
    """Return whether the answer may be put into the study."""
    return judgement.state in ("named", "group") and in_range(problem, judgement.answer.fit)
