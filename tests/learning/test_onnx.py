"""Models in ONNX Runtime: the same forces, zeros and intervals as PyTorch's, and files that say what they are."""

import json
import re
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import onnx
import pytest
import torch
from artificial_shards import study_of
from live_parts import pattern
from torch import nn

from gelforge.cli import main
from gelforge.config import Learning, write_yaml
from gelforge.learning.basis.network import Grids
from gelforge.learning.basis.scaling import ModelError, Scaling, input_flow
from gelforge.learning.deployment.equality import check_equal, trial_features
from gelforge.learning.deployment.onnx_export import export_onnx
from gelforge.learning.deployment.onnx_model import KEY, load_onnx, model_of
from gelforge.learning.elasticity.check import Check
from gelforge.learning.elasticity.inverse import WARM_ITERATIONS, Inverse
from gelforge.learning.models.model_file import Model, load_model, save_model
from gelforge.learning.models.reliability import Intervals, Zero
from gelforge.learning.networks import make_network

# name: settings of the network, grids, how flow is fed
NETWORKS = {
    "unet": ({"channels": 4}, Grids(10, 5, 5), "vector", "mirror_y"),
    "unet_inverse": ({"network": "unet_inverse", "channels": 4}, Grids(10, 5, 4), "vector", "mirror_y"),
    "cnn": ({"network": "cnn", "channels": 4}, Grids(9, 5, 4), "vector", "rotate_90"),
    "paper": ({"network": "paper", "hidden": [12, 9]}, Grids(4, 5, 5), "polar", "identity"),
}
OF_BINS = np.array([0.01, 0.3]), np.arange(9.0).reshape(3, 3), np.full((3, 3), 0.1)
CHECK = Check(np.array([1.0, 1.1, 1.2]), 0.2)
INTERVALS = Intervals(*OF_BINS, np.array([1.5]), np.ones((2, 3)), np.zeros((2, 3)))


def model_named(name: str) -> Model:
    given, grids, form, turn = NETWORKS[name]
    learning, rng = Learning(**given), np.random.default_rng(3)
    bins = grids.bins_x * grids.bins_y
    scaling = Scaling(
        form,
        turn,
        rng.normal(0, 0.1, 2 * grids.regions**2).astype("f4"),
        np.float32([0.8, 0.5]),
        rng.normal(0, 0.01, (bins, 3)).astype("f4"),
        np.float32([0.1, 0.2, 0.7]),
    )
    settings = {
        "learning": learning.usual.model_dump(mode="json"),
        "bins": {"nx": grids.bins_x, "ny": grids.bins_y},
        "features": {"regions": grids.regions},
        "sensor_width_mm": [32.0, 32.0],
        "synthetic": True,
        "views": {},
    }
    inverse = Inverse.of(rng.normal(size=(2, grids.regions**2, bins, 3)), 0.45)
    network = make_network(learning, grids, 1)
    return Model(network, scaling, settings, Zero(0.05, 0.1), INTERVALS, inverse, CHECK)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """A function that gives a model of PyTorch by name, and its ONNX file; each is made once, which takes seconds."""

    @cache
    def make(name: str):
        folder, model = tmp_path_factory.mktemp(name), model_named(name)
        save_model(folder / "model.pt", model)
        export_onnx(folder / "model.pt", folder / "model.onnx")
        return model, folder / "model.onnx"

    return make


@pytest.fixture(params=NETWORKS)
def pair(request, exported):
    return exported(request.param)


@pytest.fixture
def written(exported):
    return exported("paper")[1]


def test_forces_zeros_and_intervals_are_pytorchs(pair):
    """Single precision apart: 1e-5 of the labels' standard deviation, ten times the rounding of a sum of 1000 terms."""
    model, path = pair
    loaded = load_onnx(path)
    for feature in trial_features(model):
        expected, found = model.predict(feature), loaded.predict(feature)
        size = model.scaling.output_scale.max()
        limit = 1e-5
        if model.reads_inverse:  # its iterations make the rounding larger
            limit, size = 1e-3, max(size, np.abs(expected).max())
        np.testing.assert_allclose(found, expected, rtol=limit, atol=limit * size)


def test_the_file_says_what_it_is_and_checks_totals_as_pytorch(pair):
    # The file says what it is
    _, path = pair
    proto = onnx.load(path)
    onnx.checker.check_model(proto)
    told = json.loads({p.key: p.value for p in proto.metadata_props}[KEY])
    assert len(told["model_sha256"]) == 64
    assert told["settings"]["sensor_width_mm"] == [32.0, 32.0]
    assert told["settings"]["synthetic"] is True
    assert "[N]" in told["units"]["force_N"]

    # The check of totals is pytorchs
    model, path = pair
    loaded = load_onnx(path)
    for feature in trial_features(model)[1:]:
        force, found = loaded.answer(feature)
        expected = model.disagreement(feature, model.predict(feature))
        np.testing.assert_allclose(
            found, expected, rtol=1e-3
        )  # the network's rounding, through the inverse too
        followed, after, state = loaded.follow(feature)
        np.testing.assert_array_equal(followed, force)
        np.testing.assert_array_equal(after, found)
        next_flow = input_flow(2 * feature, "vector")
        expected = model.inverse.solve(next_flow, WARM_ITERATIONS, state).force
        assert np.abs(expected - model.inverse.solve(next_flow).force).max() > 1e-3 * np.abs(expected).max()
        np.testing.assert_array_equal(loaded.follow(2 * feature, state)[2].force, expected)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_features_that_are_not_finite_are_refused(pair, bad):
    model, path = pair
    feature = np.zeros(len(model.scaling.input_mean), np.float32)
    feature[2] = bad
    with pytest.raises(ModelError, match="1 features are not"):
        load_onnx(path).predict(feature)


def test_a_model_without_inverse_or_with_other_forces_is_told(exported, tmp_path):
    model = replace(exported("paper")[0], inverse=None, check=None)
    save_model(tmp_path / "model.pt", model)
    export_onnx(tmp_path / "model.pt", tmp_path / "model.onnx")
    feature = trial_features(model)[-1]
    assert np.isnan(load_onnx(tmp_path / "model.onnx").answer(feature)[1]).all()
    assert np.isnan(load_model(tmp_path / "model.pt").disagreement(feature, model.predict(feature))).all()

    # Forces that differ are named
    model, path = exported("paper")
    wrong = replace(model, network=nn.Sequential(model.network, _Tilted()))
    with pytest.raises(ModelError, match="not exported, ONNX Runtime and PyTorch differ in forces"):
        check_equal(wrong, load_onnx(path), "model.pt")


class _Tilted(nn.Module):
    def forward(self, outputs: torch.Tensor) -> torch.Tensor:
        return outputs * 1.001


# --------------------------------------------------------------------------------------------- commands
def test_export_takes_a_study_or_a_model_and_writes_beside_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_yaml(tmp_path / "study.yaml", study_of())
    folder = tmp_path / "results/artificial/model"
    folder.mkdir(parents=True)
    save_model(folder / "model.pt", model_named("paper"))
    assert main(["export", "--study", "study.yaml"]) == 0
    said = capsys.readouterr().out
    assert "in forces by" in said
    assert load_onnx(folder / "model.onnx").settings["synthetic"]
    assert main(["export", "--model", "nowhere.pt"]) == 1
    assert "nowhere.pt: no such file" in capsys.readouterr().err
    assert main(["export"]) == 1
    assert "--study or --model" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["export", "results/artificial/model/model.pt"])
    assert "--study or --model" in capsys.readouterr().err


def test_predict_says_how_many_frames_are_touched_and_where_they_are(exported, tmp_path, capsys):
    (tmp_path / "images").mkdir()
    for number in range(3):
        cv2.imwrite(str(tmp_path / f"images/{number}.png"), pattern(number))
    model = ["--model", str(exported("paper")[1])]
    assert main(["predict", str(tmp_path / "images"), *model, "--out", str(tmp_path / "out.csv")]) == 0
    said = capsys.readouterr().out
    assert "the first frame is taken as the reference" in said
    assert re.search(r"3 frames, [0-3] of them touched; written to .*out\.csv", said)


# ------------------------------------------------------------------------------------------------ files
def foreign(content: bytes) -> bytes:
    proto = onnx.load_from_string(content)
    del proto.metadata_props[:]
    return proto.SerializeToString()


def of_another_version(content: bytes) -> bytes:
    return content.replace(b'"format": "gelforge-onnx-3"', b'"format": "gelforge-onnx-7"')


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda b: b[: len(b) // 2], "damaged or edited"),
        (lambda b: b[:3000] + bytes([b[3000] ^ 1]) + b[3001:], "damaged or edited"),
        (lambda b: b"", "cut short, or no model that gelforge has exported"),
        (lambda b: b"no model at all", "cut short, or no model that gelforge has exported"),
    ],
    ids=["half", "one bit", "empty", "text"],
)
def test_damaged_files_give_one_line(written, tmp_path, damage, words):
    path = tmp_path / "model.onnx"
    path.write_bytes(damage(written.read_bytes()))
    with pytest.raises(ModelError, match=words) as found:
        load_onnx(path)
    assert "\n" not in str(found.value)
    assert "gelforge export" in str(found.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (foreign, "not one that gelforge has exported"),
        (of_another_version, "of format 'gelforge-onnx-7'"),
        (lambda b: b[:2000], "cannot read it"),
        (lambda b: b.replace(b'"regions": 4', b'"regions": 5'), "50 features are expected"),
        (lambda b: b.replace(b'"zero"', b'"zone"'), "metadata"),
    ],
    ids=["foreign", "version", "cut", "regions", "no thresholds"],
)
def test_contents_that_are_not_ours_give_one_line(written, change, words):
    with pytest.raises(ModelError, match=words) as found:
        model_of(change(written.read_bytes()), "model.onnx")
    assert "\n" not in str(found.value)


def test_missing_files_give_one_line(tmp_path):
    with pytest.raises(ModelError, match="no such file"):
        load_onnx(tmp_path / "none.onnx")
