"""Training on the mean squared error for a number of steps, with checkpoints to go on from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
import torch

from gelforge.config import Study
from gelforge.config.parts.learning import CompleteLearning
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.files import digest, file_sha256, write_product_table
from gelforge.learning.basis.data import (
    BUFFER_ROWS,
    FEATURE,
    LABEL,
    Batches,
    images_of_presses,
    lie_of_images,
    measure_scaling,
    one_of_each_press,
    orbits_of,
    training_and_validation,
)
from gelforge.learning.basis.network import Grids
from gelforge.learning.basis.scaling import ModelError, Scaling
from gelforge.learning.basis.turns import Turner, names_of, seen_by_camera
from gelforge.learning.elasticity.check import find_check
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.models.model_file import Model, load_tensors, save_model, save_tensors
from gelforge.learning.models.reliability import Labels, Zero, find_intervals, find_zero
from gelforge.learning.models.views import check_scale
from gelforge.learning.networks import make_network, network_of
from gelforge.learning.training.optimiser import Optimiser
from gelforge.progress import Progress, tracked
from gelforge.synthesis import SESSION

USUAL_THREADS = {"paper": 2}
CHECKPOINT_FORMAT = "gelforge-checkpoint-4"
LIGHT = 0.1  # mean square, over that of all rows, below which a contact counts less than deeper ones
SIGMAS = ("force_sigma_N", "total_force_fem_sigma_N")
SIMULATED_ALONE = "simulated images alone; its errors on real ones are not known"


@dataclass(frozen=True)
class Run:
    """How a training is run; nothing here changes what is learnt but for rounding."""

    # of torch, sums of another number of threads differ in rounding; None: two for the article's wide layers, one for small
    # networks, whose second thread gains little and waits in a loop where other work has the core
    threads: int | None = None
    checkpoint_every: int = 500  # steps, at the end of the pass in which they are reached
    buffer_rows: int = BUFFER_ROWS
    stop_after: int | None = None  # steps in this run, likewise; the next run goes on from there


@contextmanager
def _without_denormals() -> Iterator[None]:
    """Flush denormal numbers to zero meanwhile: Adam's moments of silent inputs decay into them, and they are slow.

    The mode belongs to the whole process, so it is taken back for whoever computes next.
    """
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(False)


@dataclass(frozen=True)
class Plan:
    """What a training does with its network, in addition to the network itself."""

    learning: CompleteLearning
    grids: Grids
    turns: tuple[str, ...]  # elements of D4 that sensor and camera have

    @property
    def as_article(self) -> bool:
        return network_of(self.learning.network).as_article

    @property
    def relative(self) -> bool:
        """Whether errors are taken over the force of their row; the article takes them as they are."""
        return not self.as_article


@_without_denormals()
def train(
    study: Study,
    shards: Sequence[str | Path],
    model_path: str | Path,
    loss_path: str | Path,
    run: Run = Run(),
    inverse: Inverse | None = None,
) -> bool:
    """Train the study's network and write model.pt and loss.csv.

    Passes over the training rows follow one another until `learning.steps` are taken; the last one is cut there. The model
    has the weights of the last step. Validation rows decide none of this: their loss is recorded, and thresholds and
    intervals are found on them. Their orbits are neither trained on nor tested.

    A checkpoint `<model>.checkpoint.pt` next to the model holds weights, the optimiser's moments and losses; random
    numbers depend on seed and pass only. A run that finds one of the same settings and shards goes on from it, with the
    same result as an uninterrupted run on the same machine and number of threads. One of other settings is discarded. The
    last run removes it.

    Parameters
    ----------
    study : Study
        Network, features, split and seed.
    shards : sequence of str or Path
        All shards of the dataset.
    model_path : str or Path
        model.pt.
    loss_path : str or Path
        loss.csv: the loss of training and validation rows by step.
    run : Run
        Threads, and the step after which to stop.
    inverse : Inverse, optional
        Of the study's sensor and camera, kept in the model; a network that reads its forces needs it.

    Returns
    -------
    bool
        False if the run stopped before the last step.

    Raises
    ------
    DatasetError
        For shards without images.
    """
    _check_has_images(shards)
    torch.set_num_threads(run.threads or USUAL_THREADS.get(study.learning.network, 1))
    checkpoint_path = Path(model_path).with_name(Path(model_path).stem + ".checkpoint.pt")
    settings = model_settings(study, shards)

    rows = ShardDataset(shards, "train")
    training, validation = training_and_validation(rows, shards, study)
    plan, scaling = plan_of(study, rows, training)
    learning = plan.learning
    inverse, forces = _read_inverse(learning, inverse, scaling, rows)
    if inverse is not None and forces is not None:
        settings |= {"inverse": digest([inverse.friction, inverse.singular.tolist()])}
    network = make_network(learning, plan.grids, study.seed)
    optimiser = Optimiser(network, learning)
    losses = _resume(checkpoint_path, settings, network, optimiser)
    groups = None if plan.as_article else images_of_presses(rows, training)
    size, reading = learning.batch_size, (study.seed, run.buffer_rows)
    batches = Batches(rows, training, scaling, size, *reading, groups, forces)
    monitored = one_of_each_press(rows, validation)
    watched = Batches(rows, monitored, scaling, max(size, 256), *reading, more=forces)

    done = losses[-1][0] if losses else 0
    stop = min(learning.steps, done + run.stop_after) if run.stop_after else learning.steps
    with Progress("steps", learning.steps, done) as progress:
        while done < stop:
            before = done
            done, training_loss = one_pass(network, optimiser, batches, len(losses), done, plan)
            if not np.isfinite(training_loss):
                raise ModelError(
                    f"the training loss up to step {done} is not finite; give a smaller learning.learning_rate "
                    f"(now {learning.learning_rate:g}), and check the features"
                )
            losses.append((done, training_loss, mean_loss(network, watched, plan.relative)))
            progress.advance(done - before, f"loss {losses[-1][1]:.4f}, of validation {losses[-1][2]:.4f}")
            if done >= stop or done // run.checkpoint_every > before // run.checkpoint_every:
                _save_checkpoint(checkpoint_path, settings, network, optimiser, losses)
    if done < learning.steps:
        rows.close()
        return False
    model = Model(network, scaling, settings, inverse=inverse)
    model = _with_reliability(model, rows, training, validation, orbits_of(shards))
    rows.close()
    columns = ["step", "training", "validation"]
    write_product_table(loss_path, pd.DataFrame(losses, columns=columns), "%.9g")
    save_model(model_path, model)
    checkpoint_path.unlink(missing_ok=True)
    return True


def _read_inverse(
    learning: CompleteLearning, inverse: Inverse | None, scaling: Scaling, rows: ShardDataset
) -> tuple[Inverse | None, np.ndarray | None]:
    """Return the inverse with the unit of the targets, and its forces (rows, 3 B) where the network reads them."""
    reads = network_of(learning.network).reads_inverse
    if inverse is None and reads:
        raise ModelError(
            f"learning.network: {learning.network} reads the forces of inverse elasticity, which need a block with "
            "particles and a camera that is described; set network: unet"
        )
    if inverse is None or not reads:
        return inverse, None
    inverse = replace(inverse, unit_N=scaling.output_scale)
    forces, start = np.empty((len(rows), scaling.output_mean.size), np.float32), 0
    blocks = tracked(rows.batches((FEATURE,), 256), "blocks of 256 rows inverted", -(-len(rows) // 256))
    for block in blocks:
        forces[start : start + len(block[FEATURE])] = inverse.inputs(block[FEATURE])
        start += len(block[FEATURE])
    return inverse, forces


def plan_of(study: Study, rows: ShardDataset, training: np.ndarray) -> tuple[Plan, Scaling]:
    """Return how a study's network is trained on the rows numbered by training (n,), and the scaling of these."""
    learning, bins = study.learning.usual, study.sensor.bins
    width = study.sensor.width_x_mm, study.sensor.width_y_mm
    grids = Grids(study.features.regions, bins.nx, bins.ny)
    if network_of(learning.network).as_article:
        scaling = measure_scaling(rows, training, learning.form)
        return Plan(learning, grids, ("identity",)), scaling
    if study.synthesis:  # flow follows an edge or a sheared ball too loosely to decide
        turn, along_axis = seen_by_camera(study.synthesis.camera, study.sensor)
    else:
        turn, along_axis = lie_of_images(rows, training, np.array(width))
    scaling = measure_scaling(rows, training, learning.form, turn, centred=False)
    symmetric = study.sensor_has_symmetry_of_square if study.synthesis else study.has_symmetry_of_square
    holds = along_axis and symmetric and bins.nx == bins.ny
    has_images = study.mirrors_cells and not study.synthesis  # the plan holds the mirror images of its sites
    turned = learning.symmetry == "d4" or (learning.symmetry == "auto" and holds and not has_images)
    turns = names_of(bins.nx == bins.ny and width[0] == width[1]) if turned else ("identity",)
    return Plan(learning, grids, turns), scaling


def one_pass(
    network: torch.nn.Module, optimiser: Optimiser, batches: Batches, number: int, done: int, plan: Plan
) -> tuple[int, float]:
    """Take a pass over the training rows after `done` steps, cut at the last one; return steps done and mean loss by row."""
    network.train()
    # dropout's masks depend on seed and pass only, so that a resumed run draws what an uninterrupted one does
    torch.manual_seed(int(np.random.SeedSequence([batches.seed, number]).generate_state(1)[0]))
    rng, turner = np.random.default_rng([batches.seed, number, 1]), Turner(plan.turns, *plan.grids)
    total, count = 0.0, 0
    for inputs, targets in islice(batches.of_pass(number), plan.learning.steps - done):
        if len(plan.turns) > 1:
            inputs, targets = turner(rng.integers(len(plan.turns), size=len(inputs)), inputs, targets)
        loss = mean_error(network(inputs), targets, plan.relative)
        optimiser.step(loss, done)
        done += 1
        total, count = total + loss.item() * len(inputs), count + len(inputs)
    return done, total / count


def mean_error(predicted: torch.Tensor, targets: torch.Tensor, relative: bool) -> torch.Tensor:
    """Return the mean over rows of the mean squared error of bins (n, 3 B) in scaled units.

    relative: over the row's own mean square and LIGHT, so that light contacts count next to deep ones.
    """
    error = (predicted - targets).square().mean(dim=1)
    return (error / (targets.square().mean(dim=1) + LIGHT) if relative else error).mean()


def mean_loss(network: torch.nn.Module, batches: Batches, relative: bool) -> float:
    """Return the loss per row without dropout; NaN where there is no row."""
    network.eval()
    total, count = 0.0, 0
    with torch.inference_mode():
        for inputs, targets in batches.in_order():
            total += mean_error(network(inputs), targets, relative).item() * len(inputs)
            count += len(inputs)
    return total / count if count else float("nan")


def _with_reliability(
    model: Model, rows: ShardDataset, training: np.ndarray, validation: np.ndarray, orbit: dict[str, str]
) -> Model:
    """Return a model with its thresholds and intervals, found on validation rows, and the check of its totals."""
    watched = _drawn(rows, validation, (FEATURE, LABEL, "untouched", "cell", *SIGMAS))
    if watched is None:
        return model
    force = _said(model, watched[FEATURE])
    zero = Zero()
    if model.settings["learning"]["network"] != "paper":  # the article's says what it says
        bins = model.settings["bins"]
        grid = bins["nx"], bins["ny"], np.array(model.settings["sensor_width_mm"])
        zero = find_zero(force, watched[LABEL].astype(float), watched["untouched"], grid)
    labels = Labels(*(watched[name].astype(float) for name in (LABEL, *SIGMAS)))
    groups = np.array([orbit[name] for name in watched["cell"]])
    intervals = find_intervals(zero.applied(force), labels, groups)
    model = replace(model, zero=zero, intervals=intervals)
    if model.inverse is None:
        return model
    # places near walls are in few orbits: 1500 rows of each show them
    parts = [_drawn(rows, side, (FEATURE,), 1500) for side in (training, validation)]
    feature = np.concatenate([part[FEATURE] for part in parts if part])
    total = zero.applied(_said(model, feature)).sum(axis=1)
    return replace(model, check=find_check(total, model.inverse.forces(feature).sum(axis=1)))


def _said(model: Model, feature: np.ndarray) -> np.ndarray:
    """Return what the network says of features (n, F), a few hundred rows at a time."""
    parts = np.array_split(feature, -(-len(feature) // 256))
    return np.concatenate([model.predict_raw(part) for part in parts])


def _drawn(
    rows: ShardDataset, index: np.ndarray, names: tuple[str, ...], most: int = 4000
) -> dict[str, np.ndarray] | None:
    """Return columns of at most so many of the rows index (n,), None where there is none."""
    draw = np.random.default_rng(0).permutation(len(index))[:most]
    return rows.read(index[np.sort(draw)], names) if len(index) else None


def _check_has_images(shards: Sequence[str | Path]) -> None:
    for path in shards:
        if shard_attributes(path)["labels_only"]:
            raise ModelError(
                f"{path}: holds labels only; add sessions with images to the study before training"
            )


def shards_digest(shards: Sequence[str | Path]) -> str:
    """Return the digest of the shards that a model is trained on, after checking that they are whole."""
    for path in shards:
        shard_attributes(path)
    return digest([file_sha256(path) for path in shards])


def model_settings(study: Study, shards: Sequence[str | Path]) -> dict:
    """Return what the model file says about its making; plain numbers and text.

    Parameters
    ----------
    study : Study
        Learning, features, dataset, bins and seed.
    shards : sequence of str or Path
        All shards of the dataset.

    Returns
    -------
    dict
        As `Model.settings`.
    """
    dump = study.model_dump(mode="json", include={"study", "seed", "features", "dataset"})
    attributes = [shard_attributes(path) for path in shards]
    sessions = {name: about for one in attributes for name, about in one["sessions"].items()}
    views = {name: about["view"] for name, about in sorted(sessions.items()) if about.get("view")}
    check_scale(study.features.image_scale, views)
    return {
        **dump,
        "trained_on": _trained_on(sessions),
        "learning": study.learning.usual.model_dump(mode="json", exclude={"onnx"}),
        "bins": study.sensor.bins.model_dump(mode="json"),
        "sensor_width_mm": [study.sensor.width_x_mm, study.sensor.width_y_mm],
        "synthetic": any(one["synthetic"] for one in attributes),
        "views": views,
        "shards_digest": shards_digest(shards),
    }


def _trained_on(sessions: dict[str, dict]) -> str:
    """Return in words which images a model learns from, by what its shards say of their sessions."""
    if set(sessions) == {SESSION}:
        return SIMULATED_ALONE
    recorded = [about for name, about in sessions.items() if name != SESSION]
    made = any(about.get("synthetic") for about in recorded)
    simulated = " and simulated ones" if SESSION in sessions else ""
    return ("images that a virtual lab made" if made else "recorded images") + simulated


def _save_checkpoint(path: Path, settings: dict, network, optimiser, losses: list[tuple]) -> None:
    state = {"weights": network.state_dict(), "optimiser": optimiser.state_dict()}
    content = {
        "format": CHECKPOINT_FORMAT,
        "settings": settings,
        **state,
        "losses": [list(row) for row in losses],
    }
    save_tensors(path, content)


def _resume(path: Path, settings: dict, network, optimiser) -> list[tuple[int, float, float]]:
    """Load a checkpoint of the same settings into network and optimiser; return the losses so far."""
    if not path.is_file():
        return []
    try:
        content = load_tensors(path, CHECKPOINT_FORMAT)
    except ModelError:  # a checkpoint is a convenience; a damaged one costs time, not the run
        return []
    if content["settings"] != settings:
        return []
    network.load_state_dict(content["weights"])
    optimiser.load_state_dict(content["optimiser"])
    return [(int(step), training, validation) for step, training, validation in content["losses"]]
