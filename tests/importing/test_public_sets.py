"""Public sets: made files of each layout become images with forces, and what cannot be meant is one line with the remedy."""

import csv
import json
import pickle
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from gelforge.cli import main
from gelforge.importing.public import NAMES, layout_of
from gelforge.importing.public.labelled import Options, write_labelled
from gelforge.importing.refusals import ImportingError

PAGE = Path(__file__).parents[2] / "docs" / "public-sets.md"
RNG = np.random.default_rng(5)


def image(height=24, width=32):
    return RNG.integers(0, 255, (height, width, 3), dtype=np.uint8)


def feats_sample():
    grids = {f"grid_{axis}": RNG.normal(0, 0.01, (24, 32)) for axis in "xyz"}
    sums = {f"f_{axis}": grids[f"grid_{axis}"].sum() for axis in "xyz"}
    return {"gs_img": image()} | grids | sums


def written(name, source, tmp_path, **options):
    folder = tmp_path / "out"
    folder.mkdir()
    found = write_labelled(layout_of(name), source, folder, Options(**options))
    with open(folder / "readings.csv", newline="") as file:
        return found, list(csv.DictReader(file)), folder


def test_every_layout_says_why_it_is_no_session():
    assert NAMES == ["allsight", "feats", "sparsh", "table", "taf"]
    page = PAGE.read_text()
    for name in NAMES:
        layout = layout_of(name)
        assert layout.name == name
        assert f"import-set {name} " in page
        assert len(layout.lacks) > 40


def test_feats(tmp_path):
    samples = [feats_sample() for _ in range(3)]
    for k, sample in enumerate(samples):
        np.savez(tmp_path / f"{k}.npz", **sample)
    found, rows, folder = written("feats", tmp_path, tmp_path)
    assert found.images == 3
    for row, sample in zip(rows, samples):
        assert [float(row[f"f{axis}_N"]) for axis in "xyz"] == pytest.approx(
            [sample[f"f_{axis}"] for axis in "xyz"]
        )
        assert row["x_mm"] == row["time_s"] == ""
        assert (cv2.imread(str(folder / "images" / row["image"]))[..., ::-1] == sample["gs_img"]).all()


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    """Pickles as FEATS and Sparsh publish them, converted by the script of the page."""
    folder = tmp_path_factory.mktemp("pickles")
    sample = feats_sample()
    np.save(folder / "one.npy", sample)
    batch = folder / "sphere" / "batch_1"
    batch.mkdir(parents=True)
    images = [image() for _ in range(10)]
    for k in range(2):
        chunk = [cv2.imencode(".png", one)[1].tobytes() for one in images[5 * k : 5 * k + 5]]
        (batch / f"dataset_digit_{k:02d}.pkl").write_bytes(pickle.dumps(chunk))
    force, pose = RNG.normal(0, 1, (4, 3)), RNG.normal(0, 9, (6, 7))
    trajectory = {
        "indexes": np.array([3, 4, 5, 6, 7]),
        "forces": force,
        "poses": pose,
        "slip_label": np.zeros(4, int),
    }
    labels = {"in_contact": np.array([0, 0, 0, 1, 1, 1, 1, 1, 1, 0]), "trajectories": {12: trajectory}}
    (batch / "dataset_slip_forces.pkl").write_bytes(pickle.dumps(labels))
    script = re.search(r"```python\n(.*?)```", PAGE.read_text(), re.S).group(1)
    (folder / "unpickle.py").write_text(script)
    run = subprocess.run([sys.executable, "unpickle.py", "."], cwd=folder, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return folder, sample, images, trajectory


def test_a_pickle_is_refused_with_the_remedy(converted, tmp_path):
    folder, *_ = converted
    for name, source in (
        ("feats", folder / "one.npy"),
        ("sparsh", folder / "sphere" / "batch_1" / "dataset_slip_forces.pkl"),
    ):
        out = tmp_path / name
        out.mkdir()
        with pytest.raises(
            ImportingError, match=r"a pickle can run code .* script of docs/public-sets\.md"
        ) as error:
            write_labelled(layout_of(name), source, out, Options())
        assert "\n" not in str(error.value)


def test_the_script_of_the_page_converts_and_stops_at_code(converted, tmp_path):
    folder, sample, *_ = converted
    with np.load(folder / "one.npz", allow_pickle=False) as found:
        assert {key: found[key].tolist() for key in found} == {
            key: np.asarray(sample[key]).tolist() for key in sample
        }
    for name in ("one.npy", "one.npz"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    assert written("feats", tmp_path, tmp_path)[0].images == 1  # the pickle next to is not asked for
    (tmp_path / "bad.pkl").write_bytes(pickle.dumps({"a": print}))
    run = subprocess.run(
        [sys.executable, str(folder / "unpickle.py"), str(tmp_path)], capture_output=True, text=True
    )
    assert run.returncode != 0
    assert "builtins.print is no array" in run.stderr


def test_sparsh(converted, tmp_path):
    folder, _, images, trajectory = converted
    found, rows, out = written("sparsh", folder / "sphere", tmp_path)
    assert (found.images, found.groups, found.references) == (4, 1, 1)  # an index without a force is left
    for row, number, force, pose in zip(
        rows, trajectory["indexes"], trajectory["forces"], trajectory["poses"]
    ):
        assert [float(row[f"f{axis}_N"]) for axis in "xyz"] == pytest.approx(force)
        assert [float(row[f"{axis}_mm"]) for axis in "xyz"] == pytest.approx(pose[:3])
        assert (cv2.imread(str(out / "images" / row["image"])) == images[number]).all()
    assert (cv2.imread(str(out / "references" / rows[0]["reference"])) == images[0]).all()


def allsight(folder, frames=3):
    """Write a recording as AllSight's repository has it: labels name the authors' disk."""
    data, images = (folder / "clear" / "rgb" / kind / "20" for kind in ("data/", "images"))
    date = "2023_05_11-12_43_43"
    (data / f"data_{date}").mkdir(parents=True)
    (images / f"img_{date}").mkdir(parents=True)
    rows = {}
    for k in range(frames):
        name, reference = f"image9_0.48_{k}.jpg", "image9_0.48_0.jpg"
        cv2.imwrite(str(images / f"img_{date}" / name), image())
        away = f"/home/them/dataset/clear/rgb/images/20/img_{date}/"
        pose = [[0.01 + k / 1000, 0.0, 0.02], [0.0, 0.92, 0.0, 0.38]]
        rows[name] = {"pose_ee": pose, "pose": pose, "ref_frame": away + reference, "frame": away + name, "time": 4.0 + k,
                      "theta": 0.48, "ft": [-0.1, -0.8, -3.0 - k, 0.04, 0.02, -0.001], "num": 9}  # fmt: skip
    file = data / f"data_{date}" / f"data_{date}.json"
    file.write_text(json.dumps(rows))
    (file.parent / "summary.json").write_text(json.dumps({"gel": "clear"}))
    return file


def test_allsight(tmp_path):
    allsight(tmp_path)
    found, rows, folder = written("allsight", tmp_path / "clear", tmp_path)
    assert (found.images, found.groups, found.references) == (3, 1, 1)
    assert float(rows[2]["fz_N"]) == -5.0
    assert float(rows[2]["tx_Nmm"]) == pytest.approx(40.0)
    assert float(rows[2]["x_mm"]) == pytest.approx(12.0)
    assert (folder / "images" / rows[2]["image"]).is_file()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda file: file.write_text("{}"), r"no images in it"),
        (lambda file: file.write_text("{"), r"no JSON"),
        (lambda file: file.write_text(file.read_text().replace('"ft"', '"wrench"')), r"ft, pose_ee, .* is missing"),
        (lambda file: file.write_text(file.read_text().replace("-0.001]", "]").replace(", ]", "]")), r"5 numbers, 6 are"),
        (lambda file: file.write_text(file.read_text().replace("-3.0", "NaN")), r"three numbers are needed"),
        (lambda file: next(file.parents[3].rglob("*_1.jpg")).unlink(), r"its image .* is missing; fetch the images"),
    ],
)  # fmt: skip
def test_allsight_that_cannot_be_meant(tmp_path, spoil, said):
    spoil(allsight(tmp_path))
    with pytest.raises(ImportingError, match=said) as error:
        written("allsight", tmp_path / "clear", tmp_path)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"gs_img": np.zeros((0, 0, 3), np.uint8)}, r"its image is an array \(0, 0, 3\)"),
        ({"gs_img": np.zeros((4, 4, 3))}, r"of float64, \(H, W\) or \(H, W, 3\) of uint8 is needed"),
        ({"f_z": np.zeros(0)}, r"f_z is an array \(0,\), one number is needed"),
        ({"f_z": np.float64(9.0)}, r"the grids sum to .* fetch the file again"),
    ],
)
def test_samples_that_cannot_be_meant(tmp_path, change, said):
    np.savez(tmp_path / "a.npz", **(feats_sample() | change))
    with pytest.raises(ImportingError, match=said):
        written("feats", tmp_path, tmp_path)


def test_arrays_of_another_set_are_refused(tmp_path):
    # An array without names
    np.save(tmp_path / "a.npy", np.zeros((3, 3)))
    with pytest.raises(ImportingError, match=r"holds one array \(3, 3\) and not named ones"):
        written("feats", tmp_path, tmp_path)

    # A folder of another set
    other = tmp_path / "other"
    other.mkdir()
    np.savez(other / "a.npz", forces=np.zeros(3))
    with pytest.raises(
        ImportingError, match=r"no gs_img, f_x, f_y, f_z among forces; name the folder of samples"
    ):
        written("feats", other, other)


def test_a_table_by_its_columns(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "a.png"), image())
    (tmp_path / "labels.csv").write_text("frame,Fx,Fy,Fz,z\na.png,100,200,-3000,4.5\n")
    command = [
        "import-set",
        "table",
        str(tmp_path / "labels.csv"),
        "--out",
        str(tmp_path / "set"),
        "--unit",
        "mN",
    ]
    assert main([*command, "--columns", "image=frame", "fx=Fx", "fy=Fy"]) == 1
    assert "which columns hold fz is not said" in capsys.readouterr().err
    assert not (tmp_path / "set").exists()
    assert main([*command, "--columns", "image=frame", "fx=Fx", "fy=Fy", "fz=Fz", "z_mm=z"]) == 0
    assert "no session a row per image says neither" in capsys.readouterr().out
    row = next(csv.DictReader((tmp_path / "set" / "readings.csv").read_text().splitlines()))
    assert (row["fx_N"], row["fz_N"], row["z_mm"], row["x_mm"]) == ("0.1", "-3", "4.5", "")
    assert main([*command, "--columns", "image=frame"]) == 1
    assert "exists already" in capsys.readouterr().err
