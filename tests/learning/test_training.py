"""Training: scaling from training rows only, no cell on two sides, resume, and the same result from the same seed."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import torch
from artificial_shards import small_rows, study_of, write_shards

from gelforge.config import Learning, study_from
from gelforge.dataset.shard import ShardDataset, writing_shard
from gelforge.learning.basis.data import (
    Batches,
    images_of_presses,
    measure_scaling,
    one_of_each_press,
    positions_of,
    training_and_validation,
)
from gelforge.learning.basis.network import Grids
from gelforge.learning.basis.scaling import ModelError, Scaling
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.models.model_file import load_model, load_tensors, save_model, save_tensors
from gelforge.learning.networks import make_network
from gelforge.learning.networks.paper import paper_network
from gelforge.learning.training.optimiser import LAST_RATE, MUON_RATE, WARM_UP, Optimiser, rate
from gelforge.learning.training.train import (
    CHECKPOINT_FORMAT,
    LIGHT,
    Run,
    mean_error,
    mean_loss,
    model_settings,
    plan_of,
    train,
)

QUIET = Run(threads=1, checkpoint_every=12)
SMALL = {
    "network": "paper",
    "hidden": [24, 16, 12],
    "batch_size": 8,
    "steps": 48,  # twelve passes
    "learning_rate": 1e-3,
    "validation_fraction": 0.2,
}


@pytest.fixture
def study():
    return study_of(regions=4, bins=5, **SMALL)


@pytest.fixture
def shards(study, tmp_path):
    return write_shards(tmp_path / "dataset", small_rows(), study)


def weights(path):
    return [value.numpy() for value in load_model(path).network.state_dict().values()]


# -------------------------------------------------------------------------------------------- the network
def test_the_papers_network_passes_the_signal():
    network = paper_network(3200, [800, 600, 400], 1200, 0.1, seed=0)
    shapes = [tuple(layer.weight.shape) for layer in network if isinstance(layer, torch.nn.Linear)]
    assert shapes == [(800, 3200), (600, 800), (400, 600), (1200, 400)]
    assert [type(layer).__name__ for layer in network] == ["Linear", "Sigmoid", "Dropout"] * 3 + ["Linear"]
    assert {layer.p for layer in network if isinstance(layer, torch.nn.Dropout)} == {0.1}

    # Unit inputs must not fade: PyTorch's own start leaves some 1e-3 of them after three sigmoids.
    network = paper_network(3200, [800, 600, 400], 1200, 0.1, seed=0).eval()
    inputs = torch.randn(64, 3200, generator=torch.Generator().manual_seed(0))
    outputs = network(inputs).detach()
    assert 0.1 < float((outputs - outputs.mean(dim=0)).std()) < 3
    assert abs(float(outputs.mean())) < 0.1


# ------------------------------------------------------------------------------------------------ scaling
def test_scaling_gives_unit_size_without_jumps(study, shards):
    rows = ShardDataset(shards, "train")
    index = np.arange(len(rows))
    scaling = measure_scaling(rows, index, "vector")
    block = rows.read(index, ["feature", "force_distribution_N"])
    inputs, label = scaling.inputs(block["feature"]), block["force_distribution_N"]
    # single precision
    np.testing.assert_allclose(inputs.mean(axis=0), 0, atol=1e-6)
    for half in np.split(inputs, 2, axis=1):
        assert np.mean(half.astype(float) ** 2) == pytest.approx(1, rel=1e-5)
    targets = scaling.targets(label)
    np.testing.assert_allclose(np.mean(targets.reshape(-1, 3) ** 2, axis=0), 1, rtol=1e-5)
    np.testing.assert_allclose(scaling.newtons(targets), label, atol=1e-7)

    # Regions that never move stay small
    rows = small_rows()
    rows["feature"][:, 0] = 1e-4 * np.random.default_rng(0).normal(size=len(rows["cell"]))
    scaled = measure_scaling(ShardDataset(shards), np.arange(8), "polar").inputs(rows["feature"])
    assert np.ptp(scaled[:, 0]) < 0.01

    # Vector inputs do not jump at pi
    scaling = Scaling(
        "vector", "identity", np.zeros(2, np.float32), np.ones(2, np.float32), np.zeros((1, 3)), np.ones(3)
    )
    near = scaling.inputs(np.array([[2.0, np.pi - 1e-3], [2.0, -np.pi + 1e-3]]))
    assert np.abs(near[0] - near[1]).max() < 5e-3


@pytest.mark.parametrize("form", ["vector", "polar"])
def test_scaling_does_not_know_the_test_rows(study, tmp_path, form):
    rows = small_rows()
    shards = write_shards(tmp_path / "a", rows, study)
    test_cells = {int(name[1:]) for name in positions_of(ShardDataset(shards, "test"))}
    changed = np.isin(rows["cell"], list(test_cells))
    assert 0 < changed.sum() < len(changed)
    rows["feature"][changed] *= 100
    rows["label"][changed] *= 100
    others = write_shards(tmp_path / "b", rows, study)
    files = [tmp_path / side / "model.pt" for side in "ab"]
    short = study.model_copy(
        update={"learning": study.learning.model_copy(update={"steps": 8, "input_form": form})}
    )
    for paths, file in zip((shards, others), files):
        train(short, paths, file, file.with_name("loss.csv"), QUIET)
    for one, other in zip(*(weights(file) for file in files)):
        np.testing.assert_array_equal(one, other)
    for name in ("input_mean", "input_scale", "output_mean", "output_scale"):
        one, other = (getattr(load_model(file).scaling, name) for file in files)
        np.testing.assert_array_equal(one, other)


def test_no_cell_is_on_two_sides_and_turns_follow_the_camera(study, shards):
    # No cell is on two sides and images of a press are one group
    test, train_rows = (set(positions_of(ShardDataset(shards, side))) for side in ("test", "train"))
    assert not test & train_rows
    rows = ShardDataset(shards, "train")
    training, validation = training_and_validation(rows, shards, study)
    assert sorted([*training, *validation]) == list(range(len(rows)))
    sides = [set(rows.read(index, ["cell"])["cell"]) for index in (training, validation)]
    assert not sides[0] & sides[1]
    assert all(sides)

    # Images of a press at a depth are one group
    groups = images_of_presses(rows, np.arange(len(rows)))
    block = rows.read(np.arange(len(rows)), ["press", "depth_mm", "session"])
    keys = list(zip(block["session"], block["press"], block["depth_mm"]))
    assert len(set(groups)) == len(set(keys)) == len(set(zip(groups, keys)))

    # Drawn indentations are turned though the flow follows them loosely. Whether the camera looks along the
    # sensor's axis is known there; these artificial images do not show it
    camera = {"width_px": 200, "height_px": 200, "focal_px": 272.0, "centre_px": [99.5, 99.5]}
    camera |= {"position_mm": [16.0, 16.0, -46.0]}
    described = study_of(regions=4, bins=5, network="unet").model_dump(mode="json")
    rows = ShardDataset(shards, "train")
    for moved, turns in (([0.0, 0.0, 0.0], 8), ([2.0, 0.0, 0.0], 1)):
        seen = camera | {"position_mm": np.add(camera["position_mm"], moved).tolist()}
        drawn = study_from(described | {"synthesis": {"camera": seen}})
        plan, _ = plan_of(drawn, rows, np.arange(len(rows)))
        assert len(plan.turns) == turns
    plan, _ = plan_of(study_of(regions=4, bins=5, network="unet"), rows, np.arange(len(rows)))
    assert len(plan.turns) == 1


# --------------------------------------------------------------------------------------------------- runs
def artificial_inverse(unit: float = 1.0) -> Inverse:
    """Return the inverse of an operator of the artificial rows' grids."""
    rng = np.random.default_rng(7)
    return Inverse.of(unit * rng.normal(size=(2, 16, 25, 3)), 0.45)


def test_a_network_that_reads_the_inverse_keeps_it(study, shards, tmp_path):
    """Saved, loaded and adapted, it says what it said: the unit of its inputs does not follow a gain of its outputs."""
    learning = Learning(network="unet_inverse", channels=4, batch_size=8, steps=12, validation_fraction=0.2)
    study = study.model_copy(update={"learning": learning})
    with pytest.raises(ModelError, match="reads the forces of inverse elasticity"):
        train(study, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)
    train(study, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET, artificial_inverse())
    model, feature = load_model(tmp_path / "model.pt"), small_rows()["feature"]
    np.testing.assert_array_equal(model.inverse.unit_N, model.scaling.output_scale)
    inputs = model.inputs(feature)
    np.testing.assert_array_equal(inputs[:, :32], model.scaling.inputs(feature))
    found = artificial_inverse().forces(feature)
    np.testing.assert_allclose(inputs[:, 32:].reshape(-1, 25, 3) * model.inverse.unit_N, found, atol=1e-6)
    gained = replace(model, scaling=replace(model.scaling, output_scale=2 * model.scaling.output_scale))
    np.testing.assert_allclose(
        gained.predict_raw(feature) - gained.scaling.output_mean,
        2 * (model.predict_raw(feature) - model.scaling.output_mean),
        rtol=1e-5,
        atol=1e-6,
    )
    without = replace(model, inverse=None)
    save_model(tmp_path / "without.pt", without)
    with pytest.raises(ModelError, match="reads the inverse, without it"):
        load_model(tmp_path / "without.pt")


@pytest.mark.parametrize("network", ["paper", "unet", "unet_inverse", "cnn"])
def test_resumed_equals_uninterrupted(study, shards, tmp_path, network):
    """The last pass is cut: it would end with step 48."""
    given = {"channels": 4} if network != "paper" else {"hidden": [24, 16, 12]}
    learning = Learning(network=network, batch_size=8, steps=46, validation_fraction=0.2, **given)
    study = study.model_copy(update={"learning": learning})
    inverse = artificial_inverse()
    one, other = tmp_path / "one", tmp_path / "other"
    assert train(study, shards, one / "model.pt", one / "loss.csv", QUIET, inverse)
    for done in (20, 40):
        part = replace(QUIET, stop_after=18)
        assert not train(study, shards, other / "model.pt", other / "loss.csv", part, inverse)
        assert not (other / "model.pt").exists()
        kept = load_tensors(other / "model.checkpoint.pt", CHECKPOINT_FORMAT)
        assert kept["losses"][-1][0] == done, "it went on to the end of a pass, and did not begin again"
        torch.rand(7)  # whatever else drew random numbers in between
    assert train(study, shards, other / "model.pt", other / "loss.csv", QUIET, inverse)
    assert (one / "loss.csv").read_bytes() == (other / "loss.csv").read_bytes()
    assert (one / "model.pt").read_bytes() == (other / "model.pt").read_bytes()
    assert sorted(path.name for path in other.iterdir()) == ["loss.csv", "model.pt"]


def test_a_checkpoint_of_other_settings_or_a_damaged_one_is_not_used(study, shards, tmp_path):
    fresh, other = tmp_path / "fresh", tmp_path / "other"
    train(study, shards, fresh / "model.pt", fresh / "loss.csv", QUIET)
    elsewhere = study.model_copy(update={"seed": 9})
    train(elsewhere, shards, other / "model.pt", other / "loss.csv", replace(QUIET, stop_after=16))
    train(study, shards, other / "model.pt", other / "loss.csv", QUIET)
    assert (fresh / "model.pt").read_bytes() == (other / "model.pt").read_bytes()
    (other / "model.checkpoint.pt").write_bytes(b"half a file")
    train(study, shards, other / "model.pt", other / "loss.csv", QUIET)
    assert (fresh / "model.pt").read_bytes() == (other / "model.pt").read_bytes()


def test_the_loss_falls_and_the_model_is_that_of_the_last_step(study, shards, tmp_path):
    # The loss falls
    longer = study.model_copy(update={"learning": study.learning.model_copy(update={"steps": 600})})
    train(longer, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)
    loss = pd.read_csv(tmp_path / "loss.csv")
    assert list(loss["step"]) == list(range(4, 601, 4))
    # the scaled training labels have variance 1, the loss of the training mean; dropout keeps a small network above 0.4
    assert loss["training"].iloc[-1] < 0.6
    assert loss["validation"].iloc[-1] < loss["validation"].iloc[0]

    # The model is that of the last step. At this step size the validation loss soon grows again
    last = tmp_path / "last"
    last.mkdir()
    learning = study.learning.model_copy(update={"learning_rate": 0.3, "steps": 120})
    path = last / "model.pt"
    train(study.model_copy(update={"learning": learning}), shards, path, last / "loss.csv", QUIET)
    loss = pd.read_csv(last / "loss.csv", comment="#")["validation"]
    rows = ShardDataset(shards, "train")
    model = load_model(path)
    monitored = one_of_each_press(rows, training_and_validation(rows, shards, study)[1])
    watched = Batches(rows, monitored, model.scaling, 64, seed=0)
    assert mean_loss(model.network, watched, relative=False) == pytest.approx(loss.iloc[-1], rel=1e-5)
    assert loss.idxmin() < len(loss) - 1


@pytest.mark.parametrize("content", [b"", b"half a file", None])
def test_a_damaged_model_is_named(tmp_path, content):
    path = tmp_path / "model.pt"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(ModelError, match=r"model\.pt"):
        load_model(path)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (
            lambda c: c["weights"]["9.weight"].view(torch.int32)[3:4, 5:6].bitwise_xor_(1 << 30),
            "a weight or an output is",
        ),
        (lambda c: c["weights"]["0.weight"].fill_(float("nan")), "are not finite"),
        (lambda c: c["scaling"]["output_scale"].mul_(-1), "scales"),
        (lambda c: c["scaling"]["output_mean"].mul_(1e30), "a mean label is"),
        (lambda c: c["weights"].pop("0.weight"), "RuntimeError"),
        (lambda c: c["zero"].update(contact_N=1e30), "thresholds of"),
        (lambda c: c["zero"].update(bin_N=float("nan")), "thresholds of"),
        (lambda c: c["settings"]["learning"].update(hidden=[7, 7, 7]), "RuntimeError"),
    ],
)
def test_numbers_that_no_training_gives_are_refused_behind_the_checksum(
    study, shards, tmp_path, spoil, words
):
    """One flipped bit of a weight once predicted 7e32 N."""
    path = tmp_path / "model.pt"
    train(study, shards, path, tmp_path / "loss.csv", QUIET)
    load_model(path)
    content = torch.load(path, weights_only=True)
    spoil(content)
    save_tensors(path, content)  # with a checksum that fits
    with pytest.raises(ModelError, match=rf"model\.pt: .*{words}"):
        load_model(path)


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("threads", [1, 2])
def test_two_trainings_give_the_same_bytes(study, shards, tmp_path, threads):
    for name in ("one", "other"):
        train(
            study,
            shards,
            tmp_path / name / "model.pt",
            tmp_path / name / "loss.csv",
            replace(QUIET, threads=threads),
        )
    for name in ("model.pt", "loss.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "other" / name).read_bytes()


# ------------------------------------------------------------------------------------------------ batches
@pytest.mark.parametrize("buffer_rows", [1000, 128])
def test_a_pass_visits_every_row_once_in_its_own_order(study, tmp_path, buffer_rows):
    rows = ShardDataset(write_shards(tmp_path, small_rows(cells=80), study, shards=3), "train")
    index = np.arange(len(rows))
    scaling = measure_scaling(rows, index, "polar")
    batches = Batches(rows, index, scaling, 50, seed=1, buffer_rows=buffer_rows)
    everything = np.concatenate([x.numpy() for x, _ in batches.in_order()])

    def taken(number):
        return np.concatenate([x.numpy() for x, _ in batches.of_pass(number)])

    for number in (0, 1):
        np.testing.assert_array_equal(np.unique(taken(number), axis=0), np.unique(everything, axis=0))
        np.testing.assert_array_equal(taken(number), taken(number))
    assert len(np.unique(everything, axis=0)) == len(rows) == len(taken(0))
    assert not np.array_equal(taken(0), taken(1))
    largest = max(
        len(inputs) for inputs, _, _ in batches._buffers(np.random.default_rng(0), np.arange(len(rows)))
    )
    assert largest <= max(buffer_rows, len(rows) if buffer_rows == 1000 else 0)


@pytest.mark.parametrize("buffer_rows", [1000, 64])
def test_a_pass_takes_one_image_of_each_press_and_another_the_next_time(study, tmp_path, buffer_rows):
    rows = ShardDataset(write_shards(tmp_path, small_rows(cells=40), study, shards=2), "train")
    index, groups = np.arange(len(rows)), np.arange(len(rows)) // 4
    scaling = measure_scaling(rows, index, "vector")
    batches = Batches(rows, index, scaling, 7, seed=1, buffer_rows=buffer_rows, groups=groups)
    everything = np.concatenate([x.numpy() for x, _ in batches.in_order()])
    passes = [np.concatenate([x.numpy() for x, _ in batches.of_pass(number)]) for number in (0, 1, 0)]
    for taken in passes:
        where = [int(np.flatnonzero((everything == row).all(axis=1))[0]) for row in taken]
        assert sorted(np.array(where) // 4) == sorted(set(groups))
    np.testing.assert_array_equal(passes[0], passes[2])
    assert not np.array_equal(np.sort(passes[0], axis=0), np.sort(passes[1], axis=0))


@pytest.mark.parametrize("steps", [1, 3, 50])
def test_exactly_so_many_steps_are_taken(study, shards, tmp_path, steps):
    counted = study.model_copy(update={"learning": study.learning.model_copy(update={"steps": steps})})
    taken = []
    with pytest.MonkeyPatch.context() as patch:
        step = torch.optim.Adam.step
        patch.setattr(
            torch.optim.Adam, "step", lambda self: taken.append(self.param_groups[0]["lr"]) or step(self)
        )
        train(counted, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)
    assert len(taken) == steps == pd.read_csv(tmp_path / "loss.csv", comment="#")["step"].iloc[-1]


def test_the_step_size_rises_and_falls_over_all_steps(study, shards, tmp_path):
    learning = Learning(channels=4, batch_size=8, steps=101, validation_fraction=0.2)
    rates = []
    with pytest.MonkeyPatch.context() as patch:
        step = torch.optim.AdamW.step
        patch.setattr(
            torch.optim.AdamW, "step", lambda self: rates.append(self.param_groups[0]["lr"]) or step(self)
        )
        described = study.model_copy(update={"learning": learning})
        train(described, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)
    largest = learning.usual.learning_rate
    assert int(np.argmax(rates)) == round(100 * WARM_UP)
    assert max(rates) == pytest.approx(largest)
    assert rates[-1] == pytest.approx(LAST_RATE * largest)


def test_muon_moves_by_the_step_size_and_relative_errors_count_light_contacts():
    # Muon moves kernels by the step size in all directions. A step has singular values near one (0.7 to 1.2 after
    # five iterations), times the step size and Adam's usual 0.2
    learning = Learning(channels=8, steps=2).usual
    network = make_network(learning, Grids(8, 4, 4), seed=0)
    torch.nn.init.ones_(network.last.weight)
    kernels = [layer[2].weight for layer in (*network.down, *network.up)]
    before = [kernel.detach().clone() for kernel in kernels]
    flow = torch.randn(16, 128, generator=torch.Generator().manual_seed(0))
    Optimiser(network, learning).step(network(flow).square().mean(), done=0)
    for kernel, was in zip(kernels, before):
        moved = torch.linalg.svdvals((kernel - was).detach().flatten(1))
        unit = MUON_RATE * rate(learning, 0) * 0.2 * max(kernel.flatten(1).shape) ** 0.5
        assert 0.5 < float(moved.min() / unit) and float(moved.max() / unit) < 1.4

    # Relative errors count light contacts next to deep ones. Errors of a tenth of the force count alike above LIGHT;
    # without it they go with the square of the force
    deep = torch.tensor([[10.0, -10.0]])
    light = deep / 5
    relative = [mean_error(1.1 * force, force, relative=True).item() for force in (deep, light)]
    plain = [mean_error(1.1 * force, force, relative=False).item() for force in (deep, light)]
    assert plain[0] == pytest.approx(25 * plain[1], rel=1e-5)
    assert relative[0] == pytest.approx(0.01 * 100 / (100 + LIGHT), rel=1e-5)
    assert relative[1] == pytest.approx(0.01 * 4 / (4 + LIGHT), rel=1e-5)


def test_training_leaves_denormals_and_refuses_what_cannot_train(study, shards, tmp_path):
    # Training leaves denormal numbers as they were
    train(study, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)
    assert np.finfo(float).tiny / 2 > 0
    assert np.array([np.finfo(float).tiny]) / np.array([2.0]) > 0

    # Labels alone or a diverging step size cannot train
    wild = study.model_copy(update={"learning": Learning(channels=4, steps=5, learning_rate=1e30)})
    with pytest.raises(ModelError, match=r"not finite; give a smaller learning\.learning_rate"):
        train(wild, shards, tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)

    # Labels only cannot train
    path = tmp_path / "shard.h5"
    with writing_shard(path, {"synthetic": False}, True, 32, 25):
        pass
    with pytest.raises(ModelError, match="labels only"):
        train(study, [path], tmp_path / "model.pt", tmp_path / "loss.csv", QUIET)


@pytest.mark.parametrize(
    ("sessions", "words"),
    [
        ({"simulated": True}, "simulated images alone; its errors on real ones are not known"),
        ({"simulated": True, "day1": False}, "recorded images and simulated ones"),
        ({"day1": True, "day2": True}, "images that a virtual lab made"),
        ({"day1": False}, "recorded images"),
    ],
)
def test_a_model_says_which_images_it_learnt_from(tmp_path, sessions, words):
    """sessions: whether each is synthetic."""
    attributes = {name: {"synthetic": synthetic, "view": {}} for name, synthetic in sessions.items()}
    with writing_shard(tmp_path / "0.h5", {"synthetic": True, "sessions": attributes}, False, 2, 1):
        pass
    assert model_settings(study_of(), [tmp_path / "0.h5"])["trained_on"] == words
