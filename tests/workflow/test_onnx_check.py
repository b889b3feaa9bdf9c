"""Forces of held-out images by ONNX Runtime against PyTorch's predictions, on the finished study's own images."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from gelforge.config import load_session, load_study
from gelforge.files import file_sha256
from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.deployment.held_out import check_held_out, held_out
from gelforge.learning.deployment.onnx_check import FORMAT, Difference, write_check
from gelforge.learning.deployment.onnx_export import export_onnx
from gelforge.learning.elasticity.check import Check
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.judging.predictions import LearningSets, Predictions, predict_test_rows
from gelforge.learning.models.model_file import load_model, save_model
from gelforge.learning.models.reliability import Zero

pytestmark = pytest.mark.workflow
TEST = ("--configfile", "config/test.yaml")
RESULTS, SESSION = "results/test", "morning"


def test_the_study_exports_its_model_and_compares_it(finished):
    found = json.loads((finished.folder / RESULTS / "model/onnx_check.json").read_text())
    assert found["model_sha256"] == file_sha256(finished.folder / RESULTS / "model/model.pt")
    assert found["images"] > 0
    assert found["outputs"] and all(output["share"] <= output["limit"] for output in found["outputs"])
    assert (finished.folder / RESULTS / "model/model.onnx").is_file()


def test_the_key_decides_about_the_export_and_not_about_the_training(again):
    (again.folder / RESULTS / "model/model.onnx").unlink()
    off = again.jobs(
        *TEST, "--config", "learning={onnx: false, channels: 8, steps: 5, validation_fraction: 0.3}"
    )
    assert not {"export", "onnx_check", "train"} & set(off)
    assert {"export": 1, "onnx_check": 1}.items() <= again.jobs(*TEST).items()


@pytest.fixture(scope="module")
def known(finished, tmp_path_factory):
    """A model that gives forces to every image of the finished study: model.onnx, what PyTorch says, and its SHA-256."""
    folder, study = tmp_path_factory.mktemp("model"), finished.folder / RESULTS
    shards = sorted((study / "dataset").glob("shard-*.h5"))
    trained = load_model(study / "model/model.pt")
    regions, bins = trained.settings["features"]["regions"], len(trained.scaling.output_mean)
    inverse = Inverse.of(np.random.default_rng(0).normal(size=(2, regions**2, bins, 3)), 0.45)
    with_forces = replace(trained, zero=Zero(), inverse=inverse, check=Check(np.ones(3), 0.2))
    save_model(folder / "model.pt", with_forces)
    export_onnx(folder / "model.pt", folder / "model.onnx")
    described = load_study(finished.folder / "config/test.yaml")
    predict_test_rows(folder / "model.pt", LearningSets.of(shards), described, folder / "predictions.h5")
    rows = held_out(Predictions(folder / "predictions.h5"), SESSION, study / f"features/{SESSION}.h5")
    return folder / "model.onnx", rows, file_sha256(folder / "model.pt")


@pytest.fixture
def compare(finished, known):
    described = load_study(finished.folder / "config/test.yaml")
    folder = finished.folder / described.session_folder(SESSION)

    def check(rows=known[1], sha256=known[2]):
        return check_held_out(known[0], rows, sha256, folder, load_session(folder / "session.yaml"))

    return check


def test_forces_from_images_are_pytorchs_of_the_same_model(compare, tmp_path):
    # Forces from images are pytorchs. Rounding of single precision apart, a thousandth of the limit
    found = compare()
    assert found.touched == found.images > 0
    assert [output.output for output in found.outputs] == ["forces", "the check of totals"]
    assert max(output.share for output in found.outputs) < 1e-6
    write_check(tmp_path / "check.json", found)
    written = json.loads((tmp_path / "check.json").read_text())
    assert written.pop("format") == FORMAT
    assert [Difference(**output) for output in written.pop("outputs")] == list(found.outputs)
    assert written == {name: value for name, value in asdict(found).items() if name != "outputs"}

    # Predictions of another model are refused
    with pytest.raises(ModelError, match="exported from another model"):
        compare(sha256="0" * 64)


@pytest.mark.parametrize(
    ("mistake", "named"),
    [
        (lambda rows: replace(rows, images=rows.images[::-1]), "forces"),
        (lambda rows: replace(rows, force_N=-rows.force_N), "forces by"),
        (lambda rows: replace(rows, disagreement=rows.disagreement + 0.1), "the check of totals by"),
    ],
    ids=["other images", "sign", "check"],
)
def test_a_difference_fails_and_is_named(compare, known, mistake, named):
    with pytest.raises(
        ModelError, match="held-out images of session morning ONNX Runtime differs from PyTorch"
    ) as found:
        compare(mistake(known[1]))
    assert named in str(found.value)
    assert "\n" not in str(found.value)
