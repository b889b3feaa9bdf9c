"""Parameters of a sensor from its presses: SYNTHETIC recordings of a small sensor whose gel is not the study's."""

import json
from dataclasses import replace

import numpy as np
import pytest
import specimens
import yaml
from numpy.testing import assert_allclose
from recorded import SITES, record

from gelforge.calibration.calibrate import calibrate_folder, fit_of
from gelforge.calibration.fit import ENOUGH, has_converged
from gelforge.calibration.parameters import free_of, names_of
from gelforge.calibration.priors import Prior, prior_of, youngs_modulus_kPa
from gelforge.calibration.results import scaled
from gelforge.calibration.words import inseparable
from gelforge.config import ConfigError, study_from
from gelforge.config.basis.variants import merged
from gelforge.indentation.effects.catalogue import CATALOGUE as SOLVER_EFFECTS
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.indentation.solving.error_bars import COARSER
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_and_doubts, laws_of, material_laws_of
from gelforge.materials.characterise import characterise
from gelforge.materials.fitting.law_file import read_law
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.models.yeoh import Yeoh
from gelforge.mismatch.fem.solutions import Solver
from gelforge.recording.readings import read_recording
from gelforge.report.calibration_page import write_calibration_page

# The recordings are made on the study's own coarse mesh, so that they do not show its error: it is stated as small.
MISMATCH = {"sites": 6, "discretisation": 0.002}
STIFFER = 3.0
KPA = 1e3 * specimens.GEL.youngs_modulus


def small(**keys):
    study = specimens.study()
    return study_from(merged(study.model_dump(mode="json"), {"mismatch": MISMATCH, **keys}))


def stiffer(times):
    return SOLVER_EFFECTS["gel_stiffness"](small(), times - 1)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    """Return a session of a gel that is three times as stiff as the study says, all but without noise."""
    folder = tmp_path_factory.mktemp("recorded") / "stiffer"
    return record(folder, stiffer(STIFFER), specimens.STUDY_LAWS, noise_N=0.0005)


@pytest.fixture(scope="module")
def found(recording, tmp_path_factory):
    """Return the folder of the calibration of its modulus, with what calibration.json holds."""
    out = tmp_path_factory.mktemp("calibrated")
    return out, calibrate_folder(small(), recording, ["gel.modulus"], {}, out)


def fitted(folder, kept, names, priors=None):
    solver = Solver(small(), specimens.STUDY_LAWS, {}, kept)
    return fit_of(solver, [read_recording(folder, None, small().sensor)], names, priors or {})[0]


def test_exact_presses_return_a_wrong_modulus_and_a_calibrated_file_serves_another_study(found, tmp_path):
    # Exact presses return a modulus that was three times wrong
    _, content = found
    (one,) = content["parameters"]
    assert_allclose(one["value"], STIFFER * KPA, rtol=0.01)
    low, high = one["interval_90"]
    assert low < STIFFER * KPA < high and high / low < 1.05
    assert content["converged"] and not one["at_prior"] and content["p"] > 0.01
    held = content["held_out"]
    assert held["block"] == "positions" and 1 <= held["sites"] < held["of_sites"] == len(SITES)
    assert held["after_N"]["z"] < 0.05 * held["before_N"]["z"]

    # A calibrated file serves another study and has its page
    source = found[0] / "soft.json"
    study = small(materials={"soft": {"parameters": None, "file": str(source)}})
    assert_allclose(1e3 * laws_of(study, [])["soft"].youngs_modulus, STIFFER * KPA, rtol=0.01)
    assert "file" not in small().model_dump(mode="json")["materials"]["soft"]
    with pytest.raises(ConfigError, match="exactly one of"):
        small(materials={"soft": {"file": str(source)}})

    # The page holds all chapters and is said to be synthetic
    page = write_calibration_page(found[0]).read_text()
    assert "SYNTHETIC DATA" in page and "http" not in page.replace("http://www.w3.org", "")
    for key in ("short", "curves", "sites", "apart", "origin"):
        assert f'<section id="{key}">' in page
    assert json.loads((found[0] / "calibration.json").read_text())["provenance"]["seed"] == small().seed


@pytest.mark.thorough
def test_so_do_those_of_a_gel_that_is_three_times_softer(tmp_path):
    folder = record(tmp_path / "softer", stiffer(1 / 3), specimens.STUDY_LAWS, noise_N=0.0002)
    fit = fitted(folder, tmp_path, ["gel.modulus"])
    assert_allclose(fit.free[0].value(fit.a[0]), KPA / 3, rtol=0.01)


@pytest.mark.thorough
def test_modulus_and_thickness_that_make_up_for_each_other_are_named(recording, tmp_path):
    fit = fitted(recording, tmp_path, ["gel.modulus", "skin.modulus", "gel.thickness"])
    values = [one.value(a) for one, a in zip(fit.free, fit.a)]
    truth = [STIFFER * KPA, 1e3 * specimens.SKIN.youngs_modulus, 3.0]
    away = [
        (one.coordinate(v) - one.coordinate(t)) / sd for one, v, t, sd in zip(fit.free, values, truth, fit.sd)
    ]
    assert np.abs(away).max() < 3 and fit.converged
    correlation = fit.covariance / np.outer(fit.sd, fit.sd)
    assert correlation[0, 2] > 0.9


def test_a_gain_that_presses_cannot_show_stays_at_its_prior_and_widens_the_modulus(
    recording, found, tmp_path
):
    """All moduli together are a gain: its whole uncertainty, which only a reference load makes small, is theirs."""
    gain = Prior(0.95, 1.05, "a reference load")
    names = ["gel.modulus", "skin.modulus", "force_gain"]
    fit = fitted(recording, tmp_path, names, {"force_gain": gain})
    assert fit.sd[2] > 0.95 * fit.free[2].width
    assert min(fit.sd[:2]) > 0.95 * fit.free[2].width > 2 * found[1]["parameters"][0]["sd"]
    with pytest.raises(ConfigError, match="reference load"):
        free_of(small(), specimens.STUDY_LAWS, ["force_gain"], {})


def test_the_material_file_is_taken_as_any_other_and_labels_carry_its_uncertainty(
    found, tmp_path, monkeypatch
):
    """The error bar is the change of the force per share of the modulus, on the companion's mesh, times its spread."""
    out, content = found
    patch = yaml.safe_load((out / "config.patch.yaml").read_text())
    study = study_from(merged(small().model_dump(mode="json"), patch))
    read = material_laws_of(study, [])
    laws, doubts = laws_and_doubts(read)
    assert set(doubts) == {"soft"}
    assert_allclose(1e3 * laws["soft"].youngs_modulus, content["parameters"][0]["value"])
    planned = PlannedCell("t", 8.0, 8.0, (0.6, 1.2))
    label = simulate_label(study, laws, doubts, planned).arrays
    mechanics = study.mechanics.model_copy(update={"mesh": study.mechanics.mesh.coarser(COARSER)})
    companion, sd, share = (
        study.model_copy(update={"mechanics": mechanics}),
        content["parameters"][0]["sd"],
        0.01,
    )

    def force(factor):
        own = laws | {"soft": scaled(laws["soft"], {"modulus": factor, "exponent": 1.0})}
        return simulate_cell(companion, own, planned).arrays["total_force_N"][:, 2]

    slope = np.abs(force(1 + share) - force(1 - share)) / (2 * share)
    assert_allclose(label["total_sigma_material_N"][:, 2], sd * slope, rtol=0.05)
    monkeypatch.chdir(tmp_path)
    characterise("soft", study.materials["soft"], tmp_path / "soft", "mine")
    written = read_law(tmp_path / "soft" / "law.json")
    assert_allclose(written.covariance, read["soft"].covariance)
    assert written.synthetic and written.study == "mine"


@pytest.mark.parametrize(
    "name", ["gel.modulus", "skin.exponent", "gel.thickness", "friction", "contact_point"]
)
def test_a_value_that_enters_a_study_is_the_one_it_has(name):
    (one,) = free_of(small(), specimens.STUDY_LAWS, [name], {})
    other = one.value(0.4 * one.width)
    study = one.to_study(small(), one.coordinate(one.start), one.coordinate(other))
    assert_allclose(one.kind.value(study, specimens.STUDY_LAWS, one.layers), other)
    back = one.to_study(study, one.coordinate(other), one.coordinate(one.start))
    assert_allclose(one.kind.value(back, specimens.STUDY_LAWS, one.layers), one.start)


def test_parameters_of_layers_priors_and_a_pair_that_presses_cannot_tell_apart_are_read_and_named():
    # Parameters are those of layers and what a sensor lacks is refused
    study = small(
        sensor={"layers": [layer.model_dump() | {"material": "soft"} for layer in small().sensor.layers]}
    )
    found = free_of(study, specimens.STUDY_LAWS, ["gel.modulus", "gel.thickness"], {})
    assert [list(one.layers) for one in found] == [["gel", "skin"], ["gel"]]
    with pytest.raises(ConfigError, match="two layers of one material"):
        free_of(study, specimens.STUDY_LAWS, ["gel.modulus", "skin.modulus"], {})

    # A parameter that a sensor does not have is refused with those that it has
    assert {"gel.modulus", "skin.thickness", "friction", "base.compliance"} <= set(names_of(small()))
    with pytest.raises(ConfigError, match=r"no parameter \['gel.hardness'\].*gel.modulus"):
        free_of(small(), specimens.STUDY_LAWS, ["gel.hardness"], {})
    with pytest.raises(ConfigError, match="not among --free"):
        free_of(small(), specimens.STUDY_LAWS, ["friction"], {"gel.modulus": Prior(1, 2, "")})
    assert "friction" not in names_of(small(mechanics={"friction": 0.0}))

    # Priors are read
    assert_allclose(youngs_modulus_kPa("a", 50.0), 2456, rtol=1e-3)  # Gent's relation
    soft = prior_of("gel.modulus", "shore00:30")
    assert soft.low < 100 < soft.high and soft.high / soft.low == pytest.approx(4)
    mean, sd = prior_of("gel.thickness", "3:4").normal(True)
    assert_allclose([mean - 1.6449 * sd, mean + 1.6449 * sd], np.log([3, 4]))
    for name, text in (("friction", "shoreA:10"), ("friction", "0.3"), ("friction", "2:1")):
        with pytest.raises(ConfigError, match="--prior friction"):
            prior_of(name, text)
    with pytest.raises(ConfigError, match="less than 100"):
        prior_of("gel.modulus", "shoreA:100")
    with pytest.raises(ConfigError, match="above 0"):
        free_of(small(), specimens.STUDY_LAWS, ["friction"], {"friction": Prior(-1.0, 1.0, "")})

    # A pair that presses cannot tell apart is named with its remedy
    correlations = np.array([[1, 0.97, 0.1], [0.97, 1, -0.2], [0.1, -0.2, 1]])
    (said,) = inseparable(["gel.modulus", "gel.thickness", "friction"], correlations)
    assert "gel.modulus and gel.thickness" in said and "measure the thickness" in said
    assert not list(inseparable(["gel.modulus", "friction"], np.array([[1, 0.94], [0.94, 1]])))


@pytest.mark.parametrize("law", [Ogden((2e-3, -1e-3), (1.5, -3.0)), Yeoh(5e-3, 1e-4, 2e-5)])
def test_a_scaled_law_has_all_stresses_times_the_factor_and_its_exponents_at_the_same_modulus(law):
    lam = np.array([1.2, 1.0, 1 / 1.2])
    double = scaled(law, {"modulus": 2.0, "exponent": 1.0})
    assert_allclose(double.principal_stress(lam), 2 * law.principal_stress(lam))
    faster = scaled(law, {"modulus": 1.0, "exponent": 1.5})
    assert_allclose(faster.youngs_modulus, law.youngs_modulus)
    assert_allclose(faster.principal_stress(lam), law.with_exponents(1.5).principal_stress(lam))


@pytest.mark.parametrize("hardness", [10.0, 30.0, 60.0])
def test_hardness_00_is_the_spring_s_balance_with_hertz_s_ball(hardness):
    E, R, depth = 1e-3 * youngs_modulus_kPa("00", hardness), 1.19, 2.5 * (1 - hardness / 100)
    hertz = 4 / 3 * E / (1 - 0.5**2) * np.sqrt(R) * depth**1.5
    assert_allclose(hertz, 0.203 + 0.00908 * hardness)


@pytest.mark.parametrize(
    ("step", "refused", "ends"),
    [
        ((0.5 * ENOUGH, -0.5 * ENOUGH), None, True),
        ((0.5, 0.0), None, False),
        ((-0.5, 0.0), None, False),
        ((0.5, 0.0), (-0.4, 0.1), True),  # back from a step that fitted no better
        ((0.5, 0.0), (0.4, 0.1), False),  # further the same way
        ((0.5, 0.5), (-0.4, 0.1), False),  # one parameter goes back, another still moves
    ],
)
def test_a_fit_ends_at_a_small_step_or_between_two_that_fit_no_better(step, refused, ends):
    sd, refused = np.array([1.0, 1.0]), None if refused is None else np.array(refused)
    assert has_converged(np.array(step), sd, refused) == ends
    # only steps per standard deviation count
    scaled_up = None if refused is None else 3 * refused
    assert has_converged(3 * np.array(step), 3 * sd, scaled_up) == ends


def test_columns_follow_what_a_step_has_changed(recording, tmp_path):
    fit = fitted(recording, tmp_path, ["gel.modulus", "force_gain"], {"force_gain": Prior(0.95, 1.05, "")})
    linear = fit.last
    step = np.array([0.02, -0.01])
    base = linear.problem.base * 1.05
    moved = linear.moved(linear.at + step, base, linear.study)
    change = linear.problem.observations.flat(base - linear.problem.base)
    assert_allclose(moved.columns @ step, change, atol=1e-12)
    at_rest = replace(linear.problem, candidates=moved.problem.candidates)
    assert linear.taught_by(moved).columns == pytest.approx(
        np.column_stack([p.columns for p in at_rest.candidates])
    )
