"""The material figure: what it shows follows the files it reads."""

import numpy as np
import pytest

from gelforge.config import Material, OgdenParameters
from gelforge.materials.characterise import characterise
from gelforge.report.figures.measurements.material_figure import material_figure


def drawn(folder, tests=None, parameters=None):
    material = Material(tests=tests, parameters=parameters, laws=["ogden1"])
    characterise("gel", material, folder)
    return material_figure(folder / "law.json", folder / "curves.csv")


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    tmp_path = tmp_path_factory.mktemp("fitted")
    for name, count in (("s1", 40), ("s2", 41)):  # equal curves would be refused as copies
        rows = "".join(f"{l:.6g},{20 * (l - l**-2):.6g}\n" for l in np.linspace(1, 2, count))
        (tmp_path / f"{name}.csv").write_text("# synthetic\nstretch_1,nominal_stress_kPa\n" + rows)
    (tmp_path / "samples.csv").write_text("file,test,sample\ns1.csv,uniaxial,s1\ns2.csv,uniaxial,s2\n")
    return drawn(tmp_path, tests=tmp_path)


def texts(ax):
    return " ".join(text.get_text() for text in ax.texts)


def test_samples_mean_and_model_meet_in_the_panel_of_tests_made(fitted):
    ax = fitted.axes[0]
    lines = ax.get_lines()
    assert [line.get_label() for line in lines if not line.get_label().startswith("_")] == [
        "specimens",
        "Ogden model",
        "mean of specimens",
    ]
    for line in lines:  # all end at stretch 2 with the Cauchy stress 20 (4 - 1/2) = 70 kPa
        # six digits in the file
        assert (line.get_xdata()[-1], line.get_ydata()[-1]) == pytest.approx((2, 70), rel=1e-4)
    assert "R² = 0.9999" in texts(ax) or "R² = 1.0000" in texts(ax)
    assert "2 specimens" in texts(ax)
    assert ax.get_ylabel() == "Cauchy stress [kPa]"

    # A test that was not made says so and synthetic tests are called so
    assert "not tested" in texts(fitted.axes[1])
    assert "SYNTHETIC" in fitted.get_suptitle()
    assert "E = 60.0 kPa" in fitted.get_suptitle()  # three times the shear modulus of 20 kPa


def test_a_given_law_is_drawn_alone(tmp_path):
    figure = drawn(tmp_path, parameters=OgdenParameters(mu_kPa=[10], alpha=[2]))
    assert all(len(ax.get_lines()) == 1 for ax in figure.axes[:3])
    assert "parameters given" in figure.get_suptitle()
    assert "SYNTHETIC" not in figure.get_suptitle()
