"""What decides a material decides its job: a mapping, the laws asked for, and the pictures that a test's rows name."""

import json

import cv2
import numpy as np
import pytest
import yaml
from synthetic_pictures.speckle import TensileFilm

OWN = ("--configfile", "config/own.yaml")
LAW = "results/test/materials/ecoflex_gel/law.json"
MAPPING = {
    "describes": "a strip of somebody else",
    "tests": [
        {
            "files": ["*.txt"],
            "kind": "uniaxial",
            "table": {"separator": ";", "decimal": ","},
            "strain": {"column": "Dehnung", "unit": "%", "measure": "engineering"},
            "stress": {"column": "Spannung", "unit": "kPa", "measure": "nominal"},
            "plausible_shear_modulus_kPa": [1, 100],
        }
    ],
}


def study(checkout, **material):
    """Write a study like the test's, with another description of its gel; return the jobs that its law needs."""
    content = yaml.safe_load((checkout.folder / "config/test.yaml").read_text())
    content["materials"]["ecoflex_gel"] = material
    (checkout.folder / "config/own.yaml").write_text(yaml.safe_dump(content))
    return checkout.jobs(LAW, *OWN)


def made(checkout):
    checkout.snakemake(LAW, "--cores", "1", *OWN)
    return json.loads((checkout.folder / LAW).read_text())


@pytest.mark.thorough
def test_mapping_laws_and_choice_rerun_the_fit(checkout):
    folder, mapping = checkout.folder / "data/mine", checkout.folder / "config/mine.yaml"
    folder.mkdir()
    lam = np.linspace(1, 2, 40)
    rows = [f"{100 * (l - 1):.6g};{20 * (l - l**-2):.6g}".replace(".", ",") for l in lam]
    (folder / "strip.txt").write_text("Dehnung;Spannung\n" + "\n".join(rows) + "\n")
    mapping.write_text(yaml.safe_dump(MAPPING))
    given = {"tests": "data/mine", "mapping": "config/mine.yaml", "laws": ["neo_hooke"]}
    assert study(checkout, **given) == {"characterise": 1}
    law = made(checkout)
    assert (
        law["law"] == "neo_hooke" and abs(law["parameters"][0]["value"] / 20 - 1) < 1e-4
    )  # six digits in the file
    assert study(checkout, **given) == {}
    for changed in ({"laws": ["ogden1", "neo_hooke"]}, {"choose": "first"}, {"loss": "soft_l1"}):
        assert study(checkout, **given | changed) == {"characterise": 1}
    assert study(checkout, **given) == {}
    [entry] = MAPPING["tests"]
    harder = {
        **entry,
        "stress": {**entry["stress"], "unit": "psi"},
        "plausible_shear_modulus_kPa": [10, 1000],
    }
    mapping.write_text(yaml.safe_dump({**MAPPING, "tests": [harder]}))
    assert checkout.jobs(LAW, *OWN) == {"characterise": 1}
    assert abs(made(checkout)["parameters"][0]["value"] / (20 * 6.894757) - 1) < 1e-4


@pytest.mark.thorough
def test_a_picture_that_a_row_names_reruns_the_fit(checkout):
    folder, film = checkout.folder / "data/strip", TensileFilm(np.linspace(1, 1.3, 7), shape=(140, 380))
    folder.mkdir()
    rows = []
    for k, (lam, frame) in enumerate(zip(film.stretch, film.frames())):
        cv2.imwrite(str(folder / f"{k}.png"), frame)
        rows.append(f"{k},{0.1 * (lam - lam**-2):.6f},{k}.png")
    (folder / "ua.csv").write_text("time_s,force_N,image\n" + "\n".join(rows) + "\n")
    (folder / "samples.csv").write_text("file,test,sample,width_mm,thickness_mm\nua.csv,uniaxial,s1,10,0.5\n")
    given = {"tests": "data/strip", "laws": ["neo_hooke"]}
    assert study(checkout, **given) == {"characterise": 1}
    law = made(checkout)
    assert (
        abs(law["parameters"][0]["value"] / 20 - 1) < 0.03
    )  # 0.5 % of a stretch of 1.3 is 1.7 % of its strain
    assert study(checkout, **given) == {}
    picture = folder / "6.png"
    cv2.imwrite(str(picture), film.frame(5))
    assert checkout.jobs(LAW, *OWN) == {"characterise": 1}
