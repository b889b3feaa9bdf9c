"""The material figure with several laws, further kinds of test and residuals."""

import numpy as np
import pytest

from gelforge.config import Fitting
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.characterise import characterise_source
from gelforge.materials.readers.material_source import MaterialSource
from gelforge.mechanics.laws.homogeneous import nominal_stress, stress_points
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.report.figures.measurements.material_figure import material_figure

LAW = NeoHooke(0.02)


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drawn")
    lam = np.linspace(1, 2, 40)
    tests = [
        MaterialTest("uniaxial", f"s{k}", lam, f * nominal_stress(LAW, "uniaxial", lam))
        for k, f in enumerate((0.9, 1.1))
    ]
    fixed = np.full(40, 1.5)
    along, across = (stress_points("biaxial", lam, fixed, c).measured_stress(LAW) for c in "12")
    tests.append(MaterialTest("biaxial", "b1", lam, along, stretch_2=fixed, nominal_stress_2=across))
    fitting = Fitting(laws=["neo_hooke", "ogden1"])
    result = characterise_source(MaterialSource("gel", tuple(tests)), fitting, folder)
    return material_figure(folder / "law.json", folder / "curves.csv", result.other_laws)


def lines(ax):
    return {line.get_label(): line for line in ax.get_lines() if not line.get_label().startswith("_")}


@pytest.mark.thorough
def test_all_laws_are_drawn_and_named(drawn):
    assert set(lines(drawn.axes[0])) == {"specimens", "Neo-Hooke", "Ogden, K = 1", "mean of samples"}
    assert [text.get_text() for text in drawn.legends[0].get_texts()][:2] == ["specimens", "Neo-Hooke"]
    assert "μ" not in drawn.get_suptitle()
    assert "mu = 20 kPa" in drawn.get_suptitle()


def test_biaxial_curves_have_a_panel_and_residuals_are_in_per_cent(drawn):
    panel, residual = drawn.axes[3], drawn.axes[7]
    assert panel.get_title(loc="left") == "Biaxial tension"
    ends = sorted(line.get_ydata()[-1] for line in panel.get_lines())
    # lam = (2, 1.5, 1/3): sigma_1 = 20 (4 - 1/9) = 77.8 kPa, sigma_2 = 20 (2.25 - 1/9) = 42.8 kPa; model and marks
    assert ends == pytest.approx([42.8, 42.8, 77.8, 77.8], rel=2e-3)
    assert len(residual.get_lines()) == 3  # two curves and zero
    assert "2 curves" in panel.texts[0].get_text()

    # Residuals are model minus mean in per cent
    residual = drawn.axes[4]
    for line in residual.get_lines()[:2]:
        assert np.abs(line.get_ydata()).max() < 0.1  # the mean of 0.9 and 1.1 is the law
    assert "%" in residual.get_ylabel()
