"""Causes with a free form: their maps do what they say, are found and named where they are hidden. ARTIFICIAL readings."""

from dataclasses import replace
from pathlib import Path
from runpy import run_path

import artificial
import numpy as np
import pytest
import specimens
from artificial_problem import SETTINGS, problem_of
from numpy.testing import assert_allclose
from test_findings import verdict

from gelforge.csv_table import read_csv
from gelforge.mismatch.effects.mullins import Energies, histories
from gelforge.mismatch.evidence.candidates import BOX, WIDTH, boxes
from gelforge.mismatch.evidence.gaussian import UNKNOWN
from gelforge.mismatch.evidence.kernels import Kernel, Weighed
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.free_forms import modules_of
from gelforge.mismatch.free_forms.strain_energy import TERM
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.inference.posterior import Posterior
from gelforge.mismatch.pipeline.stage import patch_of
from gelforge.mismatch.result.verdict import VERDICT, Verdict, read_verdict, write_verdict
from gelforge.mismatch.result.verdict_tables import MODULE, write_tables
from gelforge.mismatch.summary.sections import correction_table

EXAMPLE = Path("docs/adding/examples/speed_in_time.py")
MIDDLE = artificial.WIDTH / 2


def places(context):
    table = context.observations.table
    return (table[name].to_numpy(float) for name in ("x_mm", "y_mm", "depth_mm"))


def box_changes(context):
    """Return the boxes' shapes (B) and how their modulus changes the force (R, 3, B): nearer ones more, shares of it all."""
    grid = boxes(context.study)
    at = np.array([[hyperparameters[name] for name in ("x_mm", "y_mm", "z_mm")] for hyperparameters in grid])
    x, y, d = places(context)
    away = (x[:, None] - at[:, 0]) ** 2 + (y[:, None] - at[:, 1]) ** 2
    share = np.exp(-away / (2 * (2 + 0.5 * d[:, None]) ** 2) + at[:, 2] / (2 + d[:, None]))
    share /= share.sum(axis=1, keepdims=True)
    return grid, context.force[:, :, None] * share[:, None, :]


def candidates(context):
    grid, changes = box_changes(context)
    flat = context.observations.flat
    return [
        Candidate(BOX.name, hyperparameters, flat(changes[:, :, k])[:, None], BOX.prior_sd, np.zeros(1, int))
        for k, hyperparameters in enumerate(grid)
    ]


def softer_to_one_side(context):
    """Return the forces of a body whose modulus falls along x, and its relative change (B,) box by box."""
    grid, changes = box_changes(context)
    change = -0.15 * np.tanh([1.5 * (hyperparameters["x_mm"] - MIDDLE) / MIDDLE for hyperparameters in grid])
    return context.force + changes @ change, change


def wavy_depth(context):
    """Return the forces where the stage goes deeper here and less deep there."""
    x, y, d = places(context)
    return artificial.force(x, y, d + 0.05 * np.sin(2 * np.pi * (x + y) / 18))


def warming_sensor(context):
    """Return the forces as read by a sensor whose gain rises and falls again."""
    time = context.observations.table["time_s"].to_numpy(float)
    time = time / time.max()
    return context.force * (1 + 0.24 * time * (1 - time))[:, None]


def relaxing_by_a_power(base, size=0.15, power=0.35, start_s=0.2):
    """Return the forces of a gel whose overstress fades as a power of the time, and not exponentially."""
    table, found = base.observations.table, base.force.copy()
    for rows in table.groupby("press", sort=False).indices.values():
        press = table.iloc[rows]
        t, d = (np.r_[0.0, press[name].to_numpy(float)] for name in ("press_time_s", "depth_mm"))
        fine = np.linspace(0, t[-1], 2000)
        D = base.derivatives["gel_stiffness"].at(press["site"].iloc[0], np.interp(fine, t, d))
        rate = np.diff(D, axis=0)
        middle = (fine[1:] + fine[:-1]) / 2
        since = np.maximum(t[1:, None] - middle, 0.0)
        kernel = np.where(middle < t[1:, None] + 1e-9, (1 + since / start_s) ** -power, 0.0)
        found[rows] += size * kernel @ rate
    return found


def damaged(base, size=0.35):
    """Return the forces of a gel that loses stiffness by another formula, and over another reach, than the effect."""
    stiffness, found = base.derivative("gel_stiffness"), base.force.copy()
    energies = Energies(base, wider=0.2)
    for rows, W, peak in histories(base, energies):
        lost = (peak / energies.largest) ** 0.7 * -np.expm1(-3 * (peak - W) / energies.largest)
        found[rows] -= size * lost.mean(axis=1)[:, None] * stiffness[rows]
    return found


def problem(forces, seed=31):
    base = artificial.context(seed, per_side=4)
    return problem_of(
        artificial.read(base, forces(base), np.random.default_rng(seed)), boxes=candidates(base)
    )


@pytest.fixture(scope="module")
def modulus():
    found = problem(lambda base: softer_to_one_side(base)[0])
    return found, judge(found, SETTINGS, seed=1)


def module(context, name):
    return next(one for one in modules_of(context, candidates(context)) if one.name == name)


def test_a_map_of_one_number_is_an_effect_and_one_place_or_press_has_none():
    # A map of one number is an effect as wide as plausible. The first coefficient is the map's even part: one
    # depth, one modulus, one gain
    context = artificial.context(3, per_side=3)
    flat = context.observations.flat
    even = {
        "depth_map": flat(context.derivative("contact_zero")),
        "modulus_map": flat(context.force),
        "gain_in_time": flat(context.force),
    }
    for name, change in even.items():
        own = module(context, name)
        assert_allclose(own.directions[:, 0], own.basis[0, 0] * change, rtol=1e-9, atol=1e-12)
    gain = module(context, "force_map")
    of_x = (gain.map["quantity"] == "gain x").to_numpy() & (gain.basis[:, 0] != 0)
    assert_allclose(
        gain.directions[:, 0], gain.basis[of_x][0, 0] * flat(context.force * [1, 0, 0]), rtol=1e-9
    )

    # A map is as wide as is plausible
    context = artificial.context(3, per_side=5)
    own = module(context, "modulus_map")
    assert np.sqrt((own.basis**2).sum(axis=1).mean()) == pytest.approx(WIDTH, rel=0.5)
    values = own.values(np.zeros(own.basis.shape[1]), np.eye(own.basis.shape[1]))
    assert_allclose(values["sigma"], np.linalg.norm(own.basis, axis=1))

    # One place has no map of places and one press none of time
    base = artificial.context(3, per_side=3)
    rows = (base.observations.table["site"] == 0).to_numpy()
    names = ["force_hysteresis", "gain_in_time", "relaxation", "softening"]
    assert [one.name for one in modules_of(artificial.chosen(base, rows), ())] == names
    first = (base.observations.table["order"] == 0).to_numpy()
    alone = [name for name in names if name != "gain_in_time"]
    assert [one.name for one in modules_of(artificial.chosen(base, first), ())] == alone
    going_down = (base.observations.table["phase"] == "load").to_numpy()
    assert [one.name for one in modules_of(artificial.chosen(base, first & going_down), ())] == []


def test_a_body_softer_to_one_side_is_said_and_its_correction_needs_a_sure_cause(modulus, tmp_path):
    # A body softer to one side is said with its map
    body = tmp_path / "body"
    body.mkdir()
    hidden, found = modulus
    said = verdict(hidden, found)
    assert found.state == "identified" and said.model.cause == "modulus_map" and said.model.sure
    assert not said.answer and said.model.held_out.shown and said.model.corrects_labels
    assert "The body's modulus differs from place to place" in said.sentence
    table = found.model.map()
    _, change = softer_to_one_side(artificial.context(31, per_side=4))
    upper = table["z_mm"] == table["z_mm"].max()
    assert np.corrcoef(table["mean"][upper], change[upper])[0, 1] > 0.9
    assert np.mean(np.abs(table["mean"] - change) < 2 * table["sigma"]) > 0.9
    write_tables(body, {MODULE: table})
    assert len(read_csv(body / MODULE, numbers=["mean", "sigma"])) == len(table)
    assert (body / MODULE).read_text().splitlines()[0].split(",") == list(
        table
    )  # whatever the map is a function of
    write_tables(body, {MODULE: None})
    assert not (body / MODULE).exists()

    # The correction is the change and needs a cause that is sure
    correction = tmp_path / "correction"
    correction.mkdir()
    table = correction_table(hidden, found.model)
    true = softer_to_one_side(artificial.context(31, per_side=4))[0] - hidden.base
    rows = hidden.observations.table.query("phase == 'load'")
    rows = rows.drop_duplicates(["x_mm", "y_mm", "depth_mm"]).sort_values(["y_mm", "x_mm", "depth_mm"]).index
    left = table["change_z_N"].to_numpy() - true[rows, 2]
    assert np.std(left) < 0.4 * np.std(true[rows, 2])
    assert np.mean(np.abs(left) < 2 * table["sigma_z_N"]) > 0.8

    # A file without an effect needs a cause that is sure
    said = verdict(*modulus)
    write_verdict(correction, said)
    assert read_verdict(correction).model.cause == "modulus_map" and (correction / VERDICT).is_file()
    for model in (None, said.model.model_copy(update={"probability": 0.8})):
        with pytest.raises(ValueError, match="without an answer"):
            Verdict.model_validate(said.model_copy(update={"model": model}).model_dump())


def test_the_patched_study_has_the_map_and_a_gel_of_another_form_relaxes():
    # The patched study has the map of the modulus
    study = specimens.study()
    context = replace(artificial.context(3, per_side=3), study=study)
    grid = boxes(study)
    flat = np.ones((len(context.observations.flat(context.force)), 1))
    changes = [Candidate(BOX.name, s, flat, BOX.prior_sd, np.zeros(1, int)) for s in grid]
    own = next(one for one in modules_of(context, changes) if one.name == "modulus_map")
    change = np.linspace(-0.2, 0.2, len(grid))
    keys = patch_of(study, {}, (), own, own.map.assign(mean=change))
    patches = keys["mechanics"]["effects"]["geometry"]["patches"]
    assert [patch["factor"] for patch in patches] == pytest.approx((1 + change).tolist())

    # A gel that relaxes in another form relaxes. Before the spectrum was a rival, a clock that is late was claimed
    # in its place
    hidden = problem(relaxing_by_a_power)
    found = judge(hidden, SETTINGS, seed=1)
    said = verdict(hidden, found)
    assert said.state == "identified" and said.model.cause == "relaxation" and not said.answer
    assert found.posterior.holding(["viscoelastic"]) > 0.9 and not said.model.corrects_labels


@pytest.mark.thorough
def test_a_gel_that_softens_in_another_form_softens():
    hidden = problem(damaged)
    found = judge(hidden, SETTINGS, seed=1)
    said = verdict(hidden, found)
    claimed = {group.names[0] for group in said.answer} | ({said.model.cause} if said.model else set())
    assert said.state in ("identified",) and claimed <= {"mullins", "softening"}
    assert found.posterior.holding(["mullins"]) > 0.9


def test_a_form_counts_for_what_it_generalises_and_causes_share_the_chances(modulus):
    # A form counts for the effect that it generalises. All of a cause is known of a set that holds the effect, and
    # its own share of one that holds something unknown
    tried = [Kernel("relaxation", np.zeros((0, 1)), form_of=("a",)), Kernel("smooth", np.zeros((0, 1)))]
    one = Weighed(tried, {"relaxation": 3.0, "smooth": 3.0})
    known = Posterior({}, {}, {frozenset({"a"}): 4.0, frozenset({"unknown"}): 4.0}, {frozenset(): one}, 2, {})
    both = known.probability[frozenset({"a"})], known.probability[frozenset({"unknown"})]
    assert one.share_of({"a"}) == pytest.approx(0.5)
    assert known.holding(["a"]) == pytest.approx(both[0] + both[1] / 2)
    assert known.causes["relaxation"] == pytest.approx(known.holding(["a"]))
    assert known.causes["smooth"] == pytest.approx(both[1] / 2)

    # Chances of kernels add up and causes share them
    one = modulus[1].posterior.unknown[frozenset()]
    causes = {own.words for own in modulus[0].modules if own.named}
    share = 1 / (len(causes) + 1)
    assert [one.priors[words] for words in causes] == pytest.approx([np.log(share)] * len(causes))
    assert sum(np.exp(p) for words, p in one.priors.items() if words not in causes) == pytest.approx(share)

    # Chances of manners add up to that of something unknown
    posterior = modulus[1].posterior
    assert sum(posterior.kernels.values()) == pytest.approx(posterior.holding([UNKNOWN]), abs=1e-9)


def terms(context):
    """Return the changes by the terms of the energy, as the solver would give them."""
    flat = context.observations.flat(context.force)
    return [
        Candidate(TERM.name, hyperparameters, (k + 1.0) * flat[:, None], TERM.prior_sd, np.zeros(1, int))
        for k, hyperparameters in enumerate(TERM.grid(context))
    ]


def test_the_energy_of_the_map_is_in_the_study_and_the_cause_on_the_page_is_whole():
    # A study has the energy or the spectrum that makes the map
    context = replace(artificial.context(3, per_side=3), study=specimens.study())
    own = next(one for one in modules_of(context, terms(context)) if one.name == "strain_energy")
    theta = np.array([0.4, -0.2, 0.1, 0.3])
    study = own.to_study(own.to_study(context.study, own.basis @ theta), own.basis @ theta)
    correction = study.mechanics.effects.material.energy_correction
    expected = 2 * TERM.prior_sd[0] * theta  # twice over
    assert [correction["gel"].c2, correction["gel"].c3] == pytest.approx(expected[:2])
    assert [correction["skin"].c2, correction["skin"].c3] == pytest.approx(expected[2:])
    gel = (own.map["quantity"] == "gel's dW/dI1").to_numpy() & (own.map["I1_less_3"] == 0.5).to_numpy()
    assert (own.basis @ theta)[gel] == pytest.approx(TERM.prior_sd[0] * (0.4 * 2 * 0.5 - 0.2 * 3 * 0.25))

    # A study has the branches of a spectrum
    own = next(one for one in modules_of(context, ()) if one.name == "relaxation")
    gel = (own.map["quantity"] == "gel's relative modulus").to_numpy()
    moduli = np.where(gel, 0.05, -0.1)  # a negative one is none
    moduli[0] = 0.0
    branches = own.to_study(context.study, moduli).mechanics.effects.history.viscoelastic
    assert list(branches) == ["gel"] and branches["gel"].relative_moduli == [0.05] * (gel.sum() - 1)
    assert branches["gel"].times_s == own.map["relaxation_time_s"][gel].tolist()[1:]
    assert own.to_study(context.study, -np.abs(moduli)) == context.study

    # The cause that the page shows is a whole one
    file = run_path(str(EXAMPLE))
    context = artificial.context(3, per_side=3)
    own = file["FREE_FORM"].module(context, ())
    assert own.directions.shape[1] == own.basis.shape[1] and len(own.map) == len(own.basis)
    drawn = own.values(np.ones(own.basis.shape[1]), np.eye(own.basis.shape[1]))
    assert "into s1" in own.where(drawn.iloc[0]) and (drawn["sigma"] > 0).all()
    moving = np.zeros(context.force.shape, bool)
    moving[(context.observations.table["phase"] == "unload").to_numpy()] = True
    assert not own.directions[~context.observations.flat(moving).astype(bool)].any() and own.directions.any()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("forces", "cause", "words"),
    [
        (wavy_depth, "depth_map", "depth that is reached differs from place to place"),
        (warming_sensor, "gain_in_time", "changes over the session"),
    ],
)
def test_other_causes_are_said_too(forces, cause, words):
    hidden = problem(forces)
    found = judge(hidden, SETTINGS, seed=1)
    said = verdict(hidden, found)
    assert (
        said.state == "identified"
        and said.model.cause == cause
        and words in said.sentence
        and len(said.sentence.split()) <= 25
    )


@pytest.mark.thorough
def test_an_effect_of_the_catalogue_stays_preferred():
    effect = artificial.CATALOGUE["force_gain"]
    hidden = problem(lambda base: effect.to_forces(base, {}, base.force, np.array([0.04, -0.05, 0.05])))
    found = judge(hidden, SETTINGS, seed=1)
    assert found.state == "identified" and found.answer.sure[0].members[0] == "force_gain"
    assert found.posterior.holding([UNKNOWN]) < 0.2
