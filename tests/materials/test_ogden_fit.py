"""Laws recovered from raw files whose truth is known, and what the file of a law holds."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.stats import t as student

from gelforge.config import Material, OgdenParameters, load_virtual_lab
from gelforge.files import seal, without_seal
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.characterise import CURVE_COLUMNS, characterise
from gelforge.materials.fitting.curves import MeanCurve, mean_curves
from gelforge.materials.fitting.fit import FitError, fit_law
from gelforge.materials.fitting.law_file import LawFileError, MaterialLaw, read_law, write_law
from gelforge.materials.fitting.material_table import material_table
from gelforge.materials.readers.material_tests import read_material_tests
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, nominal_stress
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.virtual_lab.material_tests import make_material_tests

ROOT = Path(__file__).parents[2]
DEMO = ROOT / "data" / "demo" / "materials"
TRUTH = {  # Sferrazza et al. 2019, table 1
    "ecoflex_gel": Ogden((7.9652e-3, 0.3093e-3), (1.2769, 3.5676)),
    "elastosil_25_1": Ogden((85.1168e-3, -0.0020e-3), (2.8991, -8.2915)),
}
LARGEST = {"ecoflex_gel": 3.0, "elastosil_25_1": 2.0}


@pytest.fixture(scope="module")
def lab():
    return load_virtual_lab(ROOT / "config" / "virtual_lab" / "demo.yaml")


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """Return the laws fitted to the demo and the folder of their files."""
    folder = tmp_path_factory.mktemp("laws")
    return folder, {name: fitted(name, Material(tests=DEMO / name), folder / name) for name in TRUTH}


def fitted(name, material, folder):
    characterise(name, material, folder)
    return read_law(folder / "law.json")


def scattered(law, largest, seed, samples=6, scatter=0.02, readings=40):
    """Return curves of samples that differ by a factor of stiffness only."""
    rng = np.random.default_rng(seed)
    lam = np.linspace(1.0, largest, readings)
    return [
        MaterialTest(test, f"s{k}", lam, nominal_stress(law, test, lam) * np.exp(scatter * rng.normal()))
        for test in LOAD_CASES
        for k in range(samples)
    ]


def exact(law, largest, samples=2):
    return mean_curves(scattered(law, largest, 0, samples, scatter=0.0, readings=1000))


@pytest.mark.parametrize("name", TRUTH)
def test_parameters_without_noise_are_recovered(name):
    fit = fit_law(exact(TRUTH[name], LARGEST[name]), "ogden2")
    # what is left is the curvature between the 1000 readings, linearly interpolated
    assert_allclose(fit.law.mu, TRUTH[name].mu, rtol=0.05)
    assert_allclose(fit.law.alpha, TRUTH[name].alpha, rtol=0.01)
    assert fit.law.youngs_modulus == pytest.approx(TRUTH[name].youngs_modulus, rel=1e-4)


@pytest.mark.parametrize("name", TRUTH)
@pytest.mark.parametrize("test", LOAD_CASES)
def test_demo_stress_is_within_two_per_cent_of_the_truth(demo, name, test):
    """Six samples with 2 % scatter leave 0.8 % standard deviation in each test's mean: 2 % is 2.4 of them."""
    law = demo[1][name]
    low, high = law.valid_stretch[test]
    lam = np.linspace(max(low, 1.02), high, 200)
    assert_allclose(nominal_stress(law.law, test, lam), nominal_stress(TRUTH[name], test, lam), rtol=0.02)
    assert high == pytest.approx(LARGEST[name], abs=1e-4)
    assert law.samples[test] == 6
    assert law.r2_nominal[test] > 0.999  # 0.5 % reading noise leaves 1 - R2 of some 1e-5


@pytest.mark.thorough
def test_the_interval_of_youngs_modulus_covers_the_truth_as_often_as_it_says():
    law = TRUTH["ecoflex_gel"]
    inside, errors, sigmas = 0, [], []
    for seed in range(40):
        fit = fit_law(mean_curves(scattered(law, 3.0, seed)), "ogden2")
        gradient = fit.family.modulus_gradient(fit.parameters)
        sigmas.append(np.sqrt(gradient @ fit.covariance @ gradient))
        errors.append((fit.law.youngs_modulus - law.youngs_modulus) * 1e3)
        inside += abs(errors[-1]) < student.ppf(0.975, fit.freedom) * sigmas[-1]
    assert inside >= 33  # 38 expected; P(fewer than 33 of 40 at 95 %) = 0.3 %
    # mean predicted over observed deviation: 40 draws know it to 11 %, three of these
    assert np.sqrt(np.mean(np.square(sigmas))) / np.std(errors) == pytest.approx(1, abs=0.35)


def test_covariance_follows_the_scatter_and_every_test_counts_the_same():
    # Covariance scales with the units and with the scatter
    law = TRUTH["ecoflex_gel"]
    fit = fit_law(mean_curves(scattered(law, 3.0, 5, scatter=0.005)), "ogden2")
    stiffer = Ogden(tuple(1e3 * m for m in law.mu), law.alpha)
    scaled = fit_law(mean_curves(scattered(stiffer, 3.0, 5, scatter=0.005)), "ogden2")
    S = np.diag([1e3, 1, 1e3, 1])
    assert_allclose(scaled.covariance, S @ fit.covariance @ S, rtol=1e-4)  # convergence of the two fits
    # three stiffness factors, one per test, move the four parameters in three directions
    assert np.linalg.matrix_rank(fit.covariance, tol=1e-9, hermitian=True) == 3
    assert (np.linalg.eigvalsh(fit.covariance) > -1e-12).all()
    wider = fit_law(mean_curves(scattered(law, 3.0, 5, scatter=0.01)), "ogden2")
    ratio = np.sqrt(np.diag(wider.covariance) / np.diag(fit.covariance))
    assert_allclose(ratio, 2, rtol=0.15)  # linear in the scatter but for the curvature of the parameters

    # One sample per test still has a covariance
    curves = mean_curves(scattered(TRUTH["ecoflex_gel"], 3.0, 3, samples=1))
    fit = fit_law(curves, "ogden2")
    assert (np.linalg.eigvalsh(fit.covariance) > 0).all()

    # Every test counts the same where all samples reached. Curves that contradict each other by 10 %: both are
    # missed by the same share of their stress
    law, lam = Ogden((0.01,), (2.0,)), np.linspace(1.0, 2.0, 50)
    factors = {"uniaxial": 1.0, "pure_shear": 1.1}
    curves = [MeanCurve(t, lam, f * nominal_stress(law, t, lam)[None]) for t, f in factors.items()]
    fit = fit_law(curves, "ogden1").law
    misfit = [
        np.linalg.norm(nominal_stress(fit, c.test, lam) - c.nominal_stress) / np.linalg.norm(c.nominal_stress)
        for c in curves
    ]
    assert misfit[0] == pytest.approx(misfit[1], rel=0.25)  # unequal only by the shapes of the two curves

    # Averages use the stretches that all samples reached
    lam = np.linspace(1, 3, 30), np.linspace(1.1, 2.5, 70)
    curves = [MaterialTest("uniaxial", str(i), l, (i + 1) * (l - 1)) for i, l in enumerate(lam)]
    mean = mean_curves(curves)[0]
    assert (mean.stretch[0], mean.stretch[-1]) == (1.1, 2.5)
    assert_allclose(mean.nominal_stress, 1.5 * (mean.stretch - 1), rtol=1e-12)


def test_one_to_three_terms_if_the_curves_determine_them():
    one = fit_law(exact(Ogden((0.1,), (2.0,)), 2.0), "ogden1").law
    assert_allclose((one.mu[0], one.alpha[0]), (0.1, 2.0), rtol=1e-3)
    # at a stretch of 7.6, as far as natural rubber goes, steep start exponents ask for terms below the bounds
    far = fit_law(exact(Ogden((0.2,), (2.5,)), 7.6), "ogden1").law
    assert_allclose((far.mu[0], far.alpha[0]), (0.2, 2.5), rtol=1e-3)
    treloar = Ogden((0.63, 0.0012, -0.01), (1.3, 5.0, -2.0))
    three = fit_law(exact(treloar, 6.0), "ogden3").law
    lam = np.linspace(1.05, 6, 100)
    for test in LOAD_CASES:
        assert_allclose(nominal_stress(three, test, lam), nominal_stress(treloar, test, lam), rtol=0.02)

    # Terms that the curves do not determine are refused
    with pytest.raises(FitError, match=r"Ogden, K = 3: .*take fewer"):
        fit_law(exact(Ogden((0.01,), (2.0,)), 2.0), "ogden3")


# ------------------------------------------------------------------------------------------------- files
def test_results_are_the_same_bytes_on_a_rerun_and_the_digest_follows_the_files(demo, tmp_path):
    # Results are the same bytes on a rerun
    folder, laws = demo
    for name in laws:
        characterise(name, Material(tests=DEMO / name), tmp_path / name)
        first = {p.relative_to(folder): p.read_bytes() for p in sorted((folder / name).rglob("*.*"))}
        again = {p.relative_to(tmp_path): p.read_bytes() for p in sorted((tmp_path / name).rglob("*.*"))}
        assert again == first
        assert {"law.json", "curves.csv", "effects.json", "laws.csv"} <= {path.name for path in first}
        stored = read_law(tmp_path / name / "law.json")
        assert stored.synthetic
        content = json.loads((tmp_path / name / "law.json").read_text())
        assert content["format"] == "gelforge-law-1"
        assert content["covariance"]["parameters"] == ["mu_1_kPa", "alpha_1", "mu_2_kPa", "alpha_2"]
        assert content["youngs_modulus_kPa"] == pytest.approx(
            1.5 * np.dot(content["mu_kPa"], content["alpha"])
        )

    # The digest follows the raw files
    copy = tmp_path / "copy"
    copy.mkdir()
    for path in (DEMO / "ecoflex_gel").iterdir():
        (copy / path.name).write_bytes(path.read_bytes())
    target = copy / "uniaxial_01.csv"
    target.write_text(target.read_text().replace("# synthetic", "# Synthetic"))
    law = fitted("gel", Material(tests=copy), copy / "out")
    assert law.inputs_digest != demo[1]["ecoflex_gel"].inputs_digest
    assert law.law == demo[1]["ecoflex_gel"].law


def test_curves_and_table_hold_the_fit(demo):
    curves = pd.read_csv(demo[0] / "ecoflex_gel" / "curves.csv", dtype={"sample": str})
    assert list(without_seal(curves).columns) == CURVE_COLUMNS
    assert set(curves["sample"]) == {"mean", *(f"s{k:02d}" for k in range(1, 7))}
    assert_allclose(curves.cauchy_stress_kPa, curves.nominal_stress_kPa * curves.stretch, rtol=1e-8)
    mean = curves[curves["sample"] == "mean"]
    misfit = mean.nominal_stress_kPa - mean.model_nominal_stress_kPa
    assert misfit.abs().max() < 0.02 * mean.nominal_stress_kPa.max()

    # Table holds parameters with intervals modulus and r2
    table = material_table(list(demo[1].values()))
    assert table["quantity"].tolist()[:8] == [
        "mu_1", "alpha_1", "mu_2", "alpha_2", "E", "R2 equibiaxial", "R2 pure_shear", "R2 uniaxial",
    ]  # fmt: skip
    bounded = table[~table.quantity.str.startswith("R2")]
    assert (bounded.low_95 < bounded.value).all()
    assert (bounded.value < bounded.high_95).all()
    truth = [x for name in TRUTH for x in (*_flat(TRUTH[name]), TRUTH[name].youngs_modulus * 1e3)]
    # ten 95 % intervals of correlated quantities: at most two may miss
    assert ((bounded.low_95 < truth) & (truth < bounded.high_95)).sum() >= 8


def test_a_given_law_has_no_uncertainty_and_a_failed_fit_names_its_folder(tmp_path):
    # A given law is written without uncertainty
    parameters = OgdenParameters(mu_kPa=[85.1168, -0.0020], alpha=[2.8991, -8.2915])
    characterise("skin", Material(parameters=parameters), tmp_path)
    assert json.loads((tmp_path / "effects.json").read_text())["effects"] == []
    law = read_law(tmp_path / "law.json")
    assert_allclose(law.law.mu, TRUTH["elastosil_25_1"].mu, rtol=1e-12)
    assert law.covariance is None
    assert law.valid_stretch is None
    assert not law.synthetic
    assert pd.read_csv(tmp_path / "curves.csv").empty
    table = material_table([law])
    assert table.set_index("quantity").loc["E", "value"] == pytest.approx(370.2, abs=0.05)
    assert table[["low_95", "high_95"]].isna().all(axis=None)

    # The fit names the folder it failed on
    nine_rows = tmp_path / "nine_rows"
    nine_rows.mkdir()
    (nine_rows / "samples.csv").write_text("file,test,sample\nua.csv,uniaxial,s1\n")
    lam = np.linspace(1, 2, 9)
    rows = "".join(f"{l:.6g},{20 * (l - l**-2):.6g}\n" for l in lam)
    (nine_rows / "ua.csv").write_text("stretch_1,nominal_stress_kPa\n" + rows)
    material = Material(tests=nine_rows, laws=["ogden3"])  # six parameters, nine rows
    with pytest.raises(FitError, match=nine_rows.name):
        characterise("gel", material, nine_rows / "out")
    assert not (nine_rows / "out").exists()


def _flat(law):
    return [x for m, a in zip(law.mu, law.alpha) for x in (m * 1e3, a)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text[:-100], "not valid JSON"),
        (lambda text: text.replace("gelforge-law-1", "gelforge-law-0"), "format 'gelforge-law-0'"),
        (lambda text: text.replace('"alpha"', '"alfa"'), "KeyError 'alpha'"),
        (lambda text: text.replace("2.0", "-2.0"), "mu_1 0.01 MPa and alpha_1 -2.0"),
        (lambda text: text.replace('"ogden"', '"arruda"'), "constitutive model 'arruda'"),
    ],
)
def test_a_damaged_law_file_is_named(tmp_path, change, message):
    path = tmp_path / "law.json"
    write_law(path, MaterialLaw("gel", Ogden((0.01,), (2.0,)), "digest"))
    path.write_text(change(path.read_text()))
    with pytest.raises(LawFileError, match=r"law\.json: damaged or edited: .*snakemake -R"):
        read_law(path)
    seal(path)  # by hand, so that the checks behind the checksum are reached
    with pytest.raises(LawFileError, match=r"law\.json: .*" + message):
        read_law(path)


# ------------------------------------------------------------------------------------------- demo files
def test_demo_files_are_those_of_the_virtual_lab(lab, tmp_path):
    make_material_tests(lab, tmp_path)
    for name in TRUTH:
        made = {path.name: path.read_text() for path in (tmp_path / name).iterdir()}
        kept = {path.name: path.read_text() for path in (DEMO / name).iterdir()}
        assert made == kept
        assert all(text.startswith("# synthetic, not measured") for text in kept.values())

    # Virtual tests follow the paper and their seed
    samples = pd.read_csv(DEMO / "ecoflex_gel" / "samples.csv", comment="#")
    sizes = samples.groupby("test")[["gauge_length_mm", "width_mm"]].first().T.to_dict("list")
    assert sizes == {"uniaxial": [40, 10], "pure_shear": [10, 60], "equibiaxial": [30, 30]}
    assert samples.thickness_mm.between(0.4, 0.6).all()
    only = lab.model_copy(update={"materials": {"elastosil_25_1": lab.materials["elastosil_25_1"]}})
    make_material_tests(only, tmp_path)
    name = "elastosil_25_1/uniaxial_03.csv"
    assert (tmp_path / name).read_bytes() == (DEMO / name).read_bytes()
    other = lab.model_copy(update={"material_tests": lab.material_tests.model_copy(update={"seed": 8})})
    make_material_tests(other, tmp_path)
    assert (tmp_path / name).read_bytes() != (DEMO / name).read_bytes()
    curves = read_material_tests(tmp_path / "elastosil_25_1")
    assert max(c.stretch.max() for c in curves) == pytest.approx(2.0)
