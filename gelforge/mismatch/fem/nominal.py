"""The nominal model of a recording, and the problem that it poses with the readings.

What a study takes as known of force sensor, clock, camera or indentations (mismatch.known) becomes part of the base.
Readings of indentations that find no equilibrium are left out and reported, the others are judged.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from gelforge.config import ConfigError, Study
from gelforge.config.parts.mismatch import Known
from gelforge.indentation.paths.places import gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.mechanics.solving.equilibrium import NotConverged
from gelforge.mismatch.effects import CATALOGUE, with_dependencies
from gelforge.mismatch.evidence.candidates import BOX, candidates_of, effects_of_forces
from gelforge.mismatch.evidence.covariance import readings_covariance
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.evidence.screen import Term
from gelforge.mismatch.fem.solutions import Solver, SolverFailed, Unsolved
from gelforge.mismatch.fem.solver import Base, Choice, base_of, forces_with, forgetting, read_with
from gelforge.mismatch.free_forms import changes_of, modules_of, required
from gelforge.mismatch.inference.scan import without_spikes
from gelforge.mismatch.model.effect import Context, Curves, Effect, Hyperparameters
from gelforge.mismatch.model.images_of_presses import image_of
from gelforge.mismatch.readings.observations import Observations, spread_out
from gelforge.mismatch.readings.runs import DEPTH_DIGITS
from gelforge.mismatch.readings.sessions import observe, read_all
from gelforge.mismatch.thresholds import FEWEST
from gelforge.progress import stage
from gelforge.recording.readings import Recording

IMAGES_LEFT_OUT = (
    "sessions with a camera are judged by their forces alone (mismatch.images: left_out); `fitted` judges their images too,"
    " which takes longer and distinguishes gel stiffness from force gain"
)
SLACK_MM = 0.5 * 10.0**-DEPTH_DIGITS
# Largest element under a ball, as a share of its radius, on which a change errs by 10 % or less, the default of
# mismatch.change_error: 8 % at 0.24, 14 % at 0.3, 30 % at 0.4 (benchmarks/coarse_changes.py).
LARGEST_ELEMENT = 0.25


def with_known(base: Base, solver: Solver) -> Base:
    """Return the base with the effects that the study takes as known (the camera's: images/flow.py).

    What changes the force is then read as a known force sensor does.

    Parameters
    ----------
    base : Base
        Without them.
    solver : Solver
        Its study names them under mismatch.known.

    Returns
    -------
    Base
        The same where the study names none.

    Raises
    ------
    ConfigError
        For an effect, a parameter or a hyperparameter that does not exist.
    SolverFailed
        Where the model with them does not converge.
    """
    chosen = []
    for known in solver.study.mismatch.known:
        effect = _effect_of(known)
        if effect.to_forces is None:
            continue
        _check_hyperparameters(known, effect.grid(base.context))
        theta = np.array([known.parameters.get(p.name, 0.0) for p in effect.parameters])
        chosen.append((effect, known.hyperparameters, theta))
    if not chosen:
        return base
    try:
        force = forces_with(solver, base, chosen)
    except NotConverged as failure:
        names = ", ".join(effect.name for effect, *_ in chosen)
        raise SolverFailed(
            f"mismatch.known: the nominal model with {names} does not converge: {failure}"
        ) from None
    return _as_read(
        replace(base, context=replace(base.context, force=force)), _sensor_of(base.context, chosen)
    )


def _sensor_of(context: Context, chosen: Sequence[Choice]) -> np.ndarray:
    """Return the matrix (3, 3) by which known effects read one newton more along each axis; what only adds: as it is."""

    def read(force):
        for effect, hyperparameters, theta in chosen:
            if not effect.solved and effect.to_forces is not None:
                force = effect.to_forces(replace(context, force=force), hyperparameters, force, tuple(theta))
        return force

    alone = read(context.force)
    return np.column_stack([(read(context.force + axis) - alone)[0] for axis in np.eye(3)])


def _as_read(base: Base, sensor: np.ndarray) -> Base:
    """Return the base whose derivatives, laws and mesh's errors are read by a force sensor (3, 3), as its forces are."""

    def read(curves: Curves) -> Curves:
        return replace(curves, values=tuple(values @ sensor.T for values in curves.values))

    unread = base.context
    context = replace(
        unread,
        curves=read(unread.curves),
        derivatives={name: read(curves) for name, curves in unread.derivatives.items()},
        at_readings={name: values @ sensor.T for name, values in unread.at_readings.items()},
    )
    law, floor = np.einsum("ij,rjq->riq", sensor, base.law), np.sqrt(base.floor**2 @ (sensor**2).T)
    return replace(base, context=context, law=law, floor=floor, sensor=sensor)


def _effect_of(known: Known) -> Effect:
    effect = CATALOGUE.get(known.effect)
    if effect is None or (effect.to_forces is None and effect.to_camera is None):
        raise ConfigError(
            f"mismatch.known: no effect {known.effect!r} of forces or camera; the catalogue has {sorted(CATALOGUE)}"
        )
    unknown = set(known.parameters) - {p.name for p in effect.parameters}
    if unknown:
        names = [p.name for p in effect.parameters]
        raise ConfigError(f"mismatch.known, {known.effect}: no parameter {sorted(unknown)}; it has {names}")
    return effect


def _check_hyperparameters(known: Known, offered: Sequence[Hyperparameters]) -> None:
    """Raise ConfigError where hyperparameters are missing or not offered; numbers may lie between those offered, words not.

    Of effects that these readings cannot show, nothing is offered and nothing checked.
    """
    if not offered:
        return
    ways = {key: sorted({one[key] for one in offered}) for key in offered[0]}
    tried = "; ".join(f"{key}: {', '.join(map(str, values))}" for key, values in ways.items()) or "none"
    if set(known.hyperparameters) != set(ways):
        raise ConfigError(
            f"mismatch.known, {known.effect}: its hyperparameters are {sorted(known.hyperparameters)} and must be"
            f" {sorted(ways)}; those tried are {tried}"
        )
    for key, value in known.hyperparameters.items():
        if isinstance(value, str) and value not in ways[key]:
            raise ConfigError(f"mismatch.known, {known.effect}: no {key} {value!r}; those tried are {tried}")


def base_where_solved(solver: Solver, observations: Observations, effects: Iterable[Effect]) -> Base:
    """Return the base of the readings that it can be solved for; the observations of its context say what is left out.

    Parameters
    ----------
    solver : Solver
        Of the study.
    observations : Observations
        All readings.
    effects : iterable of Effect
        Whose derivatives are needed.

    Returns
    -------
    Base
        Forces [N] at the readings that are left.

    Raises
    ------
    SolverFailed
        Where it is not known which readings cannot be solved, and where fewer than FEWEST of them are left. Also for a gel
        that softens: what an unsolved indentation left behind is missing in all that follow.
    """
    effects, kept = list(effects), observations
    unsolved: list[Unsolved] = []
    while True:
        try:
            return base_of(solver, kept, effects)
        except SolverFailed as failure:
            unsolved += failure.presses
            fewer = without(solver, observations, unsolved)
            if solver.study.mechanics.effects.history.softens or len(fewer.force) == len(kept.force):
                raise
            share = len(fewer.force) / len(observations.force)
            if share < FEWEST:
                raise SolverFailed(
                    f"{_why(unsolved)}; {share:.0%} of the readings are left, at least {FEWEST:.0%} are needed: record"
                    " shallower indentations, or see where the study's own sites stop (`gelforge press`)"
                ) from None
            kept = fewer


def without(solver: Solver, observations: Observations, presses: Sequence[Unsolved]) -> Observations:
    """Return the observations without the readings of indentations that are not solved, at mirror images too, and say so.

    Of an indentation that went deeper than could be solved the readings of its loading to there are kept.
    """
    table = observations.table
    beyond, way_up_from = _bounds(solver, observations.sites, presses)[table["site"].to_numpy()].T
    deepest = table["deepest_mm"].to_numpy(float)
    cut = deepest > beyond + SLACK_MM
    up = (table["phase"] == "unload").to_numpy() & (cut | (deepest > way_up_from - SLACK_MM))
    left_out = up | (table["depth_mm"].to_numpy(float) > beyond + SLACK_MM)
    part = observations.chosen(~left_out)
    reached = part.table.groupby("press")["depth_mm"].transform("max")
    part = replace(
        part, table=part.table.assign(deepest_mm=np.where(cut[~left_out], reached, deepest[~left_out]))
    )
    reported = (
        f"{left_out.sum()} of {len(left_out)} readings are not judged, as {_why(presses)}; how these indentations"
        " softened the"
        " gel is not followed"
    )
    return part.at_sites(np.unique(part.table["site"])).saying(reported)


def _why(presses: Sequence[Unsolved]) -> str:
    return f"the simulation finds no equilibrium {'; '.join(one.words for one in presses)}"


def _bounds(solver: Solver, sites: np.ndarray, presses: Sequence[Unsolved]) -> np.ndarray:
    """Return per site (S, 2) [mm] the depth that is solved at most, and that from which on no unloading is."""
    study = forgetting(solver).study  # whose mirror images are solved
    bounds = np.full((len(sites), 2), np.inf)
    for number, (x, y) in enumerate(sites):
        image, _ = image_of(study, PlannedCell("", float(x), float(y), (1.0,)))
        for one in presses:
            if within(gaps_to((image.x_mm, image.y_mm), (one.x_mm, one.y_mm))[0]):
                bounds[number] = np.minimum(bounds[number], [one.beyond_mm, one.unloading_from_mm])
    return bounds


def observations_of(recorded: Sequence[Path | Recording], study: Study) -> tuple[Observations, bool]:
    """Return what is judged of some sessions, at most the study's number of sites, and whether it is synthetic.

    Parameters
    ----------
    recorded : sequence of Path or Recording
        Sessions; folders are read.
    study : Study
        Sensor and mismatch settings.

    Returns
    -------
    Observations
        Forces [N] with their errors.
    bool
        Whether any session is synthetic.

    Raises
    ------
    RecordingError
        For a session that cannot be read.
    """
    speed = study.mechanics.effects.history.timing.speed_mm_per_s
    recordings = read_all(recorded, study.sensor)
    observations = observe(recordings, study.sensor, speed, study.mismatch.contact_point_scatter_mm)
    sessions = [recording.session for recording in recordings]
    if study.mismatch.images == "left_out" and any(session.camera for session in sessions):
        observations = observations.saying(IMAGES_LEFT_OUT)
    observations = observations.saying(*large_elements(study))
    return spread(observations, study), any(session.synthetic for session in sessions)


def large_elements(study: Study) -> list[str]:
    """Return a sentence where the mesh of changes does not resolve the contact of a ball."""
    near, ball = study.mechanics.mesh.coarser(study.mismatch.coarser).near_mm, study.indenter
    limit = LARGEST_ELEMENT * ball.radius_mm
    if ball.kind != "sphere" or near <= limit:
        return []
    return [
        f"changes by effects are solved on elements of {near:.2g} mm under a ball of {ball.radius_mm:g} mm; above"
        f" {limit:.2g} mm they err by more than 10 %: lower mismatch.coarser or mechanics.mesh.near_mm"
    ]


def spread(observations: Observations, study: Study) -> Observations:
    """Return the observations at no more sites and depths than the study judges.

    Sites are the middle, then always the farthest from those; depths are spread evenly, the deepest among them.
    """
    settings, sites = study.mismatch, observations.sites
    if len(sites) > settings.sites:
        middle = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm]) / 2
        first = int(np.argmin(np.linalg.norm(sites - middle, axis=1)))
        observations = observations.at_sites(spread_out(sites, settings.sites, first)).saying(
            f"of {len(sites)} positions {settings.sites}, spread over the sensor, are judged (mismatch.sites)"
        )
    depth = observations.table["deepest_mm"].round(DEPTH_DIGITS)
    levels, most = np.unique(depth), settings.depths
    if most is None or len(levels) <= most:
        return observations
    chosen = levels[np.round(np.linspace(0, len(levels) - 1, most)).astype(int)]
    judged = observations.chosen(depth.isin(chosen).to_numpy())
    return judged.at_sites(np.unique(judged.table["site"])).saying(
        f"of indentations to {len(levels)} depths those to {most} of them are judged (mismatch.depths)"
    )


def problem_of(
    solver: Solver, observations: Observations, recorded: bool = True, names: Collection[str] | None = None
) -> tuple[Problem, Base]:
    """Return the problem of some observations: base, covariance, and the change by every effect that applies.

    recorded: False of a plan, whose forces mean nothing; names: of some effects alone.
    """
    effects = effects_of_forces(solver.study)
    if names is not None:
        effects = {name: CATALOGUE[name] for name in names}
    asked = required(solver.study, effects.values()) if recorded else with_dependencies(effects.values())
    stage("forces of the simulation, and how they follow the effects")
    base = with_known(base_where_solved(solver, observations, asked), solver)
    observations = base.context.observations
    covariance = readings_covariance(base.context, base.law, base.floor, base.solution)
    if recorded:
        read = observations.read
        observations = without_spikes(observations, base.context.force, covariance)
        base = replace(base, context=replace(base.context, observations=observations))
        covariance = covariance.restricted(observations.read[read])
    failed = dict(base.failed)
    stage("changes of the readings by each effect")
    candidates = candidates_of(base.context, effects, failed)
    changes = changes_of(base.context) if recorded else []

    def chosen(terms: Sequence[Term]) -> list[Choice]:
        return [(effects[part.name], part.hyperparameters, a) for part, a in terms]

    return (
        Problem(
            observations,
            base.context.force,
            covariance,
            candidates,
            effects,
            lambda terms, rows: forces_with(solver, base, chosen(terms), rows),
            failed,
            solver.study.mismatch.change_error,
            [one for one in changes if one.name == BOX.name],
            modules_of(base.context, changes) if recorded else (),
            lambda terms, change: read_with(base, chosen(terms), base.context.force + change),
        ),
        base,
    )
