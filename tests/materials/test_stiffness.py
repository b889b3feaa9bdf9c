"""Given parameters: their initial moduli, the question about implausible ones, and other programs' conventions."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose
from pydantic import ValidationError

from gelforge.cli import main
from gelforge.config import ConfigError, Material, write_yaml
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.stability_ahead import check_stable_ahead
from gelforge.materials.characterise import characterise, given_law
from gelforge.materials.fitting.stiffness import check_stiffness, stiffness_words
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.models.yeoh import Yeoh


def law(**parameters):
    return given_law("gel", Material(parameters=parameters).parameters)


@pytest.mark.parametrize(
    ("parameters", "shear", "words"),
    [
        ({"law": "neo_hooke", "mu_kPa": 40.0}, 40.0, "initial shear modulus 40 kPa, Young's modulus 120 kPa"),
        (
            {"law": "mooney_rivlin", "C10_kPa": 4.0, "C01_kPa": 1.0},
            10.0,
            "modulus 10 kPa, Young's modulus 30 kPa",
        ),
        ({"law": "yeoh", "C10_kPa": 5.0, "C20_kPa": -0.2}, 10.0, "shear modulus 10 kPa"),
        ({"law": "gent", "mu_kPa": 12.0, "Jm": 30.0}, 12.0, "Young's modulus 36 kPa"),
        ({"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915]}, 123.39, "Young's modulus 370.2 kPa"),
        ({"mu_kPa": [40.0], "alpha": [6.0], "convention": "abaqus"}, 40.0, "Young's modulus 120 kPa"),
        ({"mu_kPa": [40.0], "alpha": [6.0], "convention": "ansys"}, 120.0, "Young's modulus 360 kPa"),
    ],
)
def test_initial_moduli_of_every_model(parameters, shear, words):
    given = law(**parameters).law
    assert given.shear_modulus * 1e3 == pytest.approx(shear, rel=1e-4)
    assert words in stiffness_words(given)


def test_abaqus_energy_is_that_of_its_manual():
    """U = sum 2 mu_i / alpha_i^2 (l1^alpha_i + l2^alpha_i + l3^alpha_i - 3), also with a negative exponent."""
    mu, alpha = np.array([40.0, 5.0]), np.array([2.0, -2.0])
    lam = np.array([1.6, 0.9, 1 / (1.6 * 0.9)])
    U = sum(2 * m / a**2 * ((lam**a).sum() - 3) for m, a in zip(mu, alpha))
    given = law(mu_kPa=list(mu), alpha=list(alpha), convention="abaqus").law
    assert_allclose(given.principal_energy(lam) * 1e3, U, rtol=1e-13)
    assert given.shear_modulus * 1e3 == pytest.approx(mu.sum())

    # Abaqus and converted parameters press alike
    laws = [
        law(mu_kPa=[40.0], alpha=[6.0], convention="abaqus").law,
        law(mu_kPa=[40.0 / 3], alpha=[6.0]).law,
    ]
    assert_allclose(laws[0].mu, laws[1].mu, rtol=1e-14)
    assert laws[0].alpha == laws[1].alpha


@pytest.mark.parametrize(
    ("mu", "convention", "words"),
    [
        (5.0, "ogden", ["mu_kPa 5 with alpha -2", "mu_k/alpha_k", "set convention: abaqus"]),
        (5.0, "ansys", ["convention: ansys", "set convention: abaqus"]),
        (-5.0, "abaqus", ["mu_k > 0", "2 mu_k/alpha_k^2", "set convention: ogden"]),
    ],
)
def test_a_refused_term_names_both_conventions(mu, convention, words):
    with pytest.raises(ValidationError) as refused:
        Material(parameters={"mu_kPa": [40.0, mu], "alpha": [2.0, -2.0], "convention": convention})
    for word in words:
        assert word in str(refused.value)
    other = "abaqus" if convention != "abaqus" else "ogden"
    Material(parameters={"mu_kPa": [40.0, mu], "alpha": [2.0, -2.0], "convention": other})


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"law": "neo_hooke", "mu_kPa": 40.0, "D1": 0.0}, "mechanics.bulk_to_shear"),
        ({"mu_kPa": [1.0], "alpha": [2.0], "nu": 0.49}, "mechanics.bulk_to_shear"),
        ({"mu_kPa": [1.0], "alpha": [0.0]}, "no energy"),
        ({"law": "mooney_rivlin", "C10_kPa": 4.0, "C01_kPa": -1.0}, "falls without limit in compression"),
        ({"law": "yeoh", "C10_kPa": 0.0}, "greater than 0"),
    ],
)
def test_a_refused_parameter_says_why(parameters, words):
    with pytest.raises(ValidationError, match=words):
        Material(parameters=parameters)


@pytest.mark.parametrize(("mu", "unit"), [(40_000.0, "in Pa"), (0.04, "in MPa"), (1e9, "outside both")])
def test_an_implausible_stiffness_is_refused_with_the_unit_that_was_meant(mu, unit, tmp_path):
    given = {"law": "neo_hooke", "mu_kPa": mu}
    with pytest.raises(ConfigError, match="stiffness_confirmed: true") as refused:
        characterise("gel", Material(parameters=given), tmp_path)
    assert (f"are its moduli {unit}?" in str(refused.value)) == unit.startswith("in")
    assert "\n" not in str(refused.value) and not (tmp_path / "law.json").exists()
    characterise("gel", Material(parameters=given, stiffness_confirmed=True), tmp_path)
    assert (tmp_path / "law.json").is_file()


@pytest.mark.parametrize("youngs_kPa", [0.6, 16.9, 370.0, 4900.0])
def test_the_stiffness_of_gels_and_skins_is_plausible(youngs_kPa):
    check_stiffness(law(law="neo_hooke", mu_kPa=youngs_kPa / 3), confirmed=False)


def study_file(path, stiff: dict):
    study = specimens.study().model_dump(mode="json")
    study["materials"]["stiff"] = stiff
    write_yaml(path, study)
    return str(path)


def test_check_prints_moduli_and_stability_ahead_is_of_the_deepest_site(tmp_path, monkeypatch, capsys):
    # Stability ahead is that of the deepest site
    laws = {"soft": Ogden((7.9652e-3,), (1.2769,)), "stiff": Yeoh(60e-3, 0.0, -30e-3)}
    shallow, deep = (PlannedCell(name, 8.0, 8.0, (0.3, depth)) for name, depth in (("a", 0.4), ("b", 2.0)))
    check_stable_ahead(specimens.study(), laws, {"a": shallow})
    for cells in ({"a": shallow, "b": deep}, {"b": deep, "a": shallow}):
        with pytest.raises(ConfigError, match="skin is unstable"):
            check_stable_ahead(specimens.study(), laws, cells)

    # Check prints moduli and asks
    monkeypatch.chdir(tmp_path)
    stiff = {"parameters": {"law": "neo_hooke", "mu_kPa": 6700.0}}  # 20 MPa: a hard layer, or a unit
    assert main(["check", study_file(tmp_path / "s.yaml", stiff)]) == 1
    assert "materials.stiff" in capsys.readouterr().err
    confirmed = study_file(tmp_path / "s.yaml", stiff | {"stiffness_confirmed": True})
    assert main(["check", confirmed]) == 0
    printed = capsys.readouterr().out
    assert "stiff: NeoHooke, initial shear modulus 6700 kPa, Young's modulus 20100 kPa" in printed
    assert "soft: Ogden, initial shear modulus 5.637 kPa, Young's modulus 16.91 kPa" in printed

    # Yeoh that softens is accepted as far as it is stable
    monkeypatch.chdir(tmp_path)
    mild, steep = ({"law": "yeoh", "C10_kPa": 60.0, "C20_kPa": 0.5, "C30_kPa": c} for c in (-0.3, -400.0))
    assert main(["check", study_file(tmp_path / "s.yaml", {"parameters": mild})]) == 0
    assert main(["check", study_file(tmp_path / "s.yaml", {"parameters": steep})]) == 1
    message = capsys.readouterr().err
    assert (
        "the constitutive model of skin is unstable (Drucker) in" in message and "press less deep" in message
    )
