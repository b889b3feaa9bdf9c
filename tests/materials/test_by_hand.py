"""Laws in files, and characterisation by hand: folders or files in, law, tables, figure and notes out."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from test_laws_fitted import GEL, TRUE, exact

from gelforge.config import Fitting
from gelforge.csv_table import TableError
from gelforge.files import write_product_json
from gelforge.materials.characterise import characterise_source, material_law
from gelforge.materials.fitting.curves import mean_curves
from gelforge.materials.fitting.fit import FitError, fit_law
from gelforge.materials.fitting.law_file import read_law, write_law
from gelforge.materials.fitting.material_table import material_table
from gelforge.materials.readers.material_source import read_sources
from gelforge.mechanics.laws.homogeneous import principal_stretches
from gelforge.mechanics.laws.models import FAMILIES, parameters_of

ROOT = Path(__file__).parents[2]
MAPPING = """
describes: ten points of a strip
tests:
  - files: ['*.csv']
    kind: uniaxial
    strain: {column: stretch, measure: stretch}
    stress: {column: stress, unit: UNIT, measure: nominal}
    plausible_shear_modulus_kPa: [1, 100]
"""


@pytest.mark.parametrize("name", [n for n in TRUE if n != "ogden3"])
def test_law_files_of_all_laws_read_back(tmp_path, name):
    fit = fit_law(mean_curves(exact(TRUE[name])), name)
    write_law(tmp_path / "law.json", material_law("rubber", fit, "digest", False, ["a note"]))
    stored = read_law(tmp_path / "law.json")
    assert_allclose(parameters_of(stored.law), fit.parameters, rtol=1e-9)
    assert type(stored.law) is type(TRUE[name])
    assert_allclose(stored.covariance, fit.covariance, rtol=1e-9)
    assert stored.freedom == fit.freedom
    assert stored.notes == ("a note",)
    content = json.loads((tmp_path / "law.json").read_text())
    assert [p["unit"] for p in content["parameters"]] == [
        FAMILIES[name].unit(p) for p in FAMILIES[name].parameters
    ]
    lam = np.array([principal_stretches("equibiaxial", np.array(v)) for v in (2.9, 3.1)])
    assert stored.valid_range.outside(lam).tolist() == [False, True]
    table = material_table([stored]).set_index("quantity")
    assert table.loc["E", "value"] == pytest.approx(fit.law.youngs_modulus * 1e3, rel=1e-8)


def test_a_law_file_written_before_other_laws_existed_still_has_its_range(tmp_path):
    fit = fit_law(mean_curves(exact(GEL)), "ogden2")
    write_law(tmp_path / "law.json", material_law("gel", fit, "digest", False))
    content = json.loads((tmp_path / "law.json").read_text())
    for key in ("parameters", "valid_states", "unstable_from", "fitted_by", "notes"):
        del content[key]
    write_product_json(tmp_path / "law.json", content)
    assert read_law(tmp_path / "law.json").valid_range.largest("uniaxial") == pytest.approx(3.0)


# ------------------------------------------------------------------------------------------------ by hand
def test_a_folder_becomes_law_tables_and_notes(tmp_path):
    [gel] = read_sources([ROOT / "data" / "demo" / "materials" / "ecoflex_gel"], None)
    result = characterise_source(gel, Fitting(laws=["ogden2", "yeoh"], bootstrap=50), tmp_path)
    assert gel.synthetic
    assert result.comparison.chosen.name == "ogden2"
    assert [p.name for p in result.other_laws] == ["yeoh.json"]
    assert read_law(tmp_path / "law.json").synthetic
    parameters = pd.read_csv(tmp_path / "parameters.csv").set_index(["law", "quantity"])
    E = parameters.loc[("ogden2", "E")]
    assert E.low_95 < E.value < E.high_95
    assert E.low_95_bootstrap < E.value < E.high_95_bootstrap
    assert set(pd.read_csv(tmp_path / "laws.csv").law) == {"ogden2", "yeoh"}
    assert "lowest AICc" in (tmp_path / "notes.txt").read_text()
    first = {p: p.read_bytes() for p in sorted(tmp_path.rglob("*.*"))}
    characterise_source(gel, Fitting(laws=["ogden2", "yeoh"], bootstrap=50), tmp_path)
    assert {p: p.read_bytes() for p in sorted(tmp_path.rglob("*.*"))} == first


def test_sources_that_cannot_be_read_or_are_too_few_are_named(tmp_path):
    # Sources that cannot be read or believed are named
    with pytest.raises(TableError, match=r"nowhere: no such file or folder"):
        read_sources([tmp_path / "nowhere"], None)
    (tmp_path / "a.csv").write_text("x,y\n1,2\n")
    with pytest.raises(TableError, match=r"a\.csv: a single file needs a mapping"):
        read_sources([tmp_path / "a.csv"], None)

    # A wrong unit is refused
    with pytest.raises(
        TableError, match=r"shear modulus of .* kPa; 1 to 100 kPa is declared plausible: check the units"
    ):
        read_sources(*strip(tmp_path, unit="MPa"))

    # Ten points are not fitted in silence
    few = tmp_path / "few"
    few.mkdir()
    [material] = read_sources(*strip(few))
    with pytest.raises(FitError, match=r"Ogden, K = 2: 10 rows for 4 parameters; 12 at least"):
        characterise_source(material, Fitting(laws=["ogden2"]), few / "out")
    assert not (few / "out").exists()
    result = characterise_source(material, Fitting(laws=["neo_hooke", "ogden2"]), few / "out")
    assert result.comparison.chosen.name == "neo_hooke"
    assert any("fewer than 12 rows" in text for text in result.comparison.warnings)
    assert any("NOT IDENTIFIABLE" in text for text in read_law(few / "out" / "law.json").notes)


def strip(folder, unit="kPa", rows=10):
    lam = np.linspace(1, 2, rows)
    text = "".join(f"{l:.6g},{20 * (l - l**-2):.6g}\n" for l in lam)
    (folder / "strip.csv").write_text("stretch,stress\n" + text)
    (folder / "mapping.yaml").write_text(MAPPING.replace("UNIT", unit))
    return [folder / "strip.csv"], folder / "mapping.yaml"
