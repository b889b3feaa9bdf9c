"""The folder that `gelforge import` writes is one that the reader of recordings accepts, with the truth in it."""

from dataclasses import replace

import cv2
import numpy as np
import pandas as pd
import pytest
from raw_logs import CAMERA, MAPPING, Lab, generate

from gelforge.cli import main
from gelforge.recording.readings import read_recording, sample_rows

LAB = Lab(presses=5, fps=24.0, lead_s=1.0)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    folder = tmp_path_factory.mktemp("raw")
    truth = generate(folder, LAB, seed=3)
    (folder / "mapping.yaml").write_text(MAPPING + CAMERA)
    assert main(["import", str(folder / "mapping.yaml"), "--out", str(folder / "s1")]) == 0
    return folder / "s1", truth


def test_the_session_is_accepted_and_its_page_and_images_show_the_contacts(session):
    # The session is accepted and its page shows the contacts
    folder, truth = session
    recording = read_recording(folder)
    assert [line for line in recording.findings.lines("error", "excluded")] == []
    samples = sample_rows(recording)
    held = samples[samples["phase"] == "dwell"].groupby("press")
    assert np.abs(held["depth_mm"].first() - truth.depth_mm).max() < 0.02
    assert (held.size() == 3).all()
    assert held["x_mm"].first().tolist() == pytest.approx([10.0, 13.0, 16.0, 10.0, 13.0], abs=0.002)
    # the force that relaxes at depth, less zero: stiffness d^1.5 (1 + 0.15 d), between all and none of it relaxed
    d = np.array(truth.depth_mm)
    elastic = LAB.stiffness * d**1.5 * (1 + 0.15 * d)
    ratio = -held["fz_N"].last().to_numpy() / elastic
    assert ((1 - LAB.relaxes - 0.02 < ratio) & (ratio < 1.0)).all()

    # Page and table of presses lie next to
    page = cv2.imread(str(folder / "import.png"))
    assert page.shape[1] > 1000
    found = pd.read_csv(folder / "import.csv")
    assert np.abs(found["contact_mm"] - truth.contact_z_mm).max() < 0.04

    # Images show their depth. A frame of a wait differs from the reference by more where the press is deeper, a
    # zero frame by noise
    folder, _ = session
    table = pd.read_csv(folder / "indentations.csv", keep_default_na=False)
    reference = cv2.imread(str(folder / "reference.png"), 0).astype(float)
    named = table[table["image"] != ""]
    change = [
        np.abs(cv2.imread(str(folder / "images" / name), 0) - reference).mean() for name in named["image"]
    ]
    change = pd.Series(change, named.index)
    still = change[named["phase"] == "zero"]
    moved = change[named["phase"] == "dwell"]
    assert still.max() < 0.5 * moved.min()
    depth = named.loc[moved.index, "depth_mm"].astype(float)
    assert moved[depth > 1.0].min() > moved[depth < 0.5].max()


def test_nothing_is_replaced_and_names_are_names(session, capsys):
    folder, _ = session
    mapping = folder.parent / "mapping.yaml"
    assert main(["import", str(mapping), "--out", str(folder)]) == 1
    assert "exists already" in capsys.readouterr().err
    assert main(["import", str(mapping), "--out", str(folder.parent / "a b")]) == 1
    assert "is not a name" in capsys.readouterr().err


def test_a_session_that_is_refused_leaves_the_page_alone(tmp_path, capsys):
    lab = replace(LAB, fps=0.0, presses=3)
    generate(tmp_path, lab)
    mapping = MAPPING.replace("{acts_on: sensor}", "{acts_on: sensor, range_N: [0.1, 0.1, 0.1]}")
    (tmp_path / "mapping.yaml").write_text(mapping)
    assert main(["import", str(tmp_path / "mapping.yaml"), "--out", str(tmp_path / "s1")]) == 1
    error = capsys.readouterr().err
    assert "beyond 0.1 N (force.range_N)" in error
    assert error.count("\n") == 1
    left = sorted(path.name for path in tmp_path.iterdir() if "import" in path.name or path.name == "s1")
    assert left == ["s1.import.png"]
