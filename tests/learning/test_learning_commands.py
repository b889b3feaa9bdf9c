"""`gelforge train` and `evaluate`: memory that runs out, and a model that was trained with other settings, are one line."""

import numpy as np
import pytest
import torch
from artificial_shards import small_rows, study_of, write_shards

from gelforge.cli import main
from gelforge.config import write_yaml
from gelforge.learning.judging.predictions import LearningSets
from gelforge.learning.training.train import Run, train

SMALL = {"channels": 4, "batch_size": 8, "steps": 8, "validation_fraction": 0.2}


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A study's shards and the model that was trained on them."""
    folder, study = tmp_path_factory.mktemp("trained"), study_of(regions=4, bins=5, **SMALL)
    shards = write_shards(folder / "dataset", small_rows(), study)
    train(study, shards, folder / "model.pt", folder / "loss.csv", Run(threads=1))
    return study, shards, folder / "model.pt"


@pytest.fixture
def command(trained, tmp_path, monkeypatch, capsys):
    """A function that runs a command on the study, with other settings if given: exit code and what it printed."""
    monkeypatch.setattr(
        "gelforge.cli.model.learning.learning_sets", lambda _: LearningSets(trained[1], trained[1])
    )
    monkeypatch.setattr("gelforge.dataset.manifest.check_shards", lambda *_: None)

    def run(name, *arguments, **changed):
        study = trained[0].model_copy(update=changed)
        write_yaml(tmp_path / "study.yaml", study)
        code = main([name, "--study", str(tmp_path / "study.yaml"), *map(str, arguments)])
        return code, capsys.readouterr().err

    return run


def raising(error):
    def fail(*_, **__):
        raise error

    return fail


@pytest.mark.parametrize(
    ("fail", "words"),
    [
        (lambda *_: torch.empty(2**45), "no memory is left, 134217728 MiB were asked for"),
        (lambda *_: np.empty(2**50), "no memory is left"),
        (
            raising(torch.cuda.OutOfMemoryError("CUDA out of memory. Tried to allocate 2.00 GiB. GPU 0 has")),
            "no memory is left of the GPU, 2.00 GiB were asked for",
        ),
        (raising(RuntimeError("CUDA error: out of memory")), "no memory is left of the GPU"),
        (raising(RuntimeError("could not create a primitive")), "no memory is left"),
    ],
    ids=["PyTorch", "NumPy", "CUDA", "CUDA's driver", "oneDNN"],
)
def test_a_training_without_memory_says_so(command, tmp_path, monkeypatch, fail, words):
    monkeypatch.setattr("gelforge.learning.training.train.one_pass", fail)
    code, said = command("train", "--model", tmp_path / "model.pt", "--loss", tmp_path / "loss.csv")
    line = said.strip().splitlines()[-1]
    assert code == 1
    assert line.startswith(f"gelforge: {words}")
    assert "learning.batch_size (now 8) or learning.channels (now 4)" in line
    assert "Traceback" not in said


def test_other_errors_are_called_memory_only_if_they_are(command, tmp_path, monkeypatch):
    monkeypatch.setattr("gelforge.learning.training.train.one_pass", raising(RuntimeError("shapes differ")))
    with pytest.raises(RuntimeError, match="shapes differ"):
        command("train", "--model", tmp_path / "model.pt", "--loss", tmp_path / "loss.csv")

    # A library that finds no memory is one line
    error = ImportError("libtorch_cpu.so: failed to map segment from shared object")
    monkeypatch.setattr("gelforge.cli.model.learning.load_study", raising(error))
    code, said = command("train", "--model", tmp_path / "model.pt", "--loss", tmp_path / "loss.csv")
    assert code == 1
    assert "no memory is left" in said


def test_a_model_of_the_study_is_evaluated_whether_it_is_exported_or_not(command, trained, tmp_path):
    learning = trained[0].learning.model_copy(update={"onnx": True})
    code, said = command("evaluate", "--model", trained[2], "--out", tmp_path / "p.h5", learning=learning)
    assert (code, said) == (0, "")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda study: {"seed": 7}, "seed: 2 in the model, 7 in the study"),
        (
            lambda study: {"learning": study.learning.model_copy(update={"steps": 9})},
            "learning.steps: 8 in the model, 9 in the study",
        ),
        (
            lambda study: {"features": study.features.model_copy(update={"moved_px": 0.1})},
            "features.moved_px: 0.05 in the model, 0.1 in the study",
        ),
        (
            lambda study: {"dataset": study.dataset.model_copy(update={"test_fraction": 0.4})},
            "dataset.test_fraction: 0.2 in the model, 0.4 in the study",
        ),
    ],
    ids=["seed", "learning", "features", "dataset"],
)
def test_a_model_of_other_settings_is_not_evaluated(command, trained, tmp_path, change, words):
    code, said = command("evaluate", "--model", trained[2], "--out", tmp_path / "p.h5", **change(trained[0]))
    assert code == 1
    assert words in said
    assert "train the model again" in said
    assert not (tmp_path / "p.h5").exists()
