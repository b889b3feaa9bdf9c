"""Training as in Sferrazza et al. 2019, table 2: Adam on the mean squared error, with checkpoints to go on from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import torch
from tqdm import tqdm

from gelforge.config import Study
from gelforge.dataset.shard import ShardDataset, shard_attributes
from gelforge.dataset.splits import split_orbits
from gelforge.files import digest, file_sha256, write_product_table
from gelforge.learning.data import BUFFER_ROWS, Batches, measure_scaling, positions_of, subset
from gelforge.learning.network import Model, ModelError, load_tensors, make_network, save_model, save_tensors

CHECKPOINT_FORMAT = "gelforge-checkpoint-1"


@dataclass(frozen=True)
class Run:
    """How a training is run; nothing here changes what is learnt but for rounding."""

    threads: int = 2  # of torch; sums of another number of threads differ in rounding
    checkpoint_every: int = 20  # epochs
    buffer_rows: int = BUFFER_ROWS
    progress: bool = True
    stop_after: int | None = None  # epochs in this run; the next run goes on from there


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


@_without_denormals()
def train(
    study: Study,
    shards: Sequence[str | Path],
    model_path: str | Path,
    loss_path: str | Path,
    run: Run = Run(),
) -> bool:
    """Train the study's network and write model.pt and loss.csv; return False if the run stopped before the last epoch.

    A checkpoint `<model>.checkpoint.pt` beside the model holds weights, Adam's moments and losses; random numbers
    depend on seed and epoch only. A run that finds one of the same settings and shards goes on from it, with the same
    result as an uninterrupted run on the same machine and number of threads; one of other settings is discarded. It is
    removed at the end. The validation cells only watch the loss; the model is that of the last epoch.
    """
    _check_has_images(shards)
    torch.set_num_threads(run.threads)
    checkpoint_path = Path(model_path).with_name(Path(model_path).stem + ".checkpoint.pt")
    settings = _settings(study, shards)

    rows = ShardDataset(shards, "train")
    training, validation = _validation_split(rows, shards, study)
    scaling = measure_scaling(rows, training, study.learning.input_form)
    learning = study.learning
    network = make_network(
        len(scaling.input_mean), learning.hidden, scaling.output_mean.size, learning.dropout, study.seed
    )
    adam = torch.optim.Adam(network.parameters(), lr=learning.learning_rate)
    losses = _resume(checkpoint_path, settings, network, adam)
    batches = Batches(rows, training, scaling, learning.batch_size, study.seed, run.buffer_rows)
    watched = Batches(rows, validation, scaling, learning.batch_size, study.seed, run.buffer_rows)

    last = min(learning.epochs, len(losses) + run.stop_after) if run.stop_after else learning.epochs
    bar = tqdm(
        range(len(losses), last),
        initial=len(losses),
        total=learning.epochs,
        unit="epoch",
        disable=not run.progress,
    )
    for epoch in bar:
        training_loss = one_epoch(network, adam, batches, epoch)
        losses.append((epoch + 1, training_loss, mean_loss(network, watched)))
        bar.set_postfix(training=f"{losses[-1][1]:.4f}", validation=f"{losses[-1][2]:.4f}")
        if (epoch + 1) % run.checkpoint_every == 0 or epoch + 1 == last:
            _save_checkpoint(checkpoint_path, settings, network, adam, losses)
    rows.close()
    if last < learning.epochs:
        return False
    columns = ["epoch", "training", "validation"]
    write_product_table(loss_path, pd.DataFrame(losses, columns=columns), "%.9g")
    save_model(model_path, Model(network, scaling, settings))
    checkpoint_path.unlink(missing_ok=True)
    return True


def one_epoch(network: torch.nn.Module, adam: torch.optim.Optimizer, batches: Batches, epoch: int) -> float:
    """Take one pass over the training rows and return the mean loss, with dropout, per row."""
    network.train()
    # dropout's masks depend on seed and epoch only, so that a resumed run draws what an uninterrupted one does
    torch.manual_seed(int(np.random.SeedSequence([batches.seed, epoch]).generate_state(1)[0]))
    total, count = 0.0, 0
    for inputs, targets in batches.epoch(epoch):
        adam.zero_grad(set_to_none=True)
        loss = torch.nn.functional.mse_loss(network(inputs), targets)
        loss.backward()
        adam.step()
        total, count = total + loss.item() * len(inputs), count + len(inputs)
    return total / count


def mean_loss(network: torch.nn.Module, batches: Batches) -> float:
    """Return the mean squared error per row without dropout; NaN where there is no row."""
    network.eval()
    total, count = 0.0, 0
    with torch.inference_mode():
        for inputs, targets in batches.in_order():
            total += torch.nn.functional.mse_loss(network(inputs), targets).item() * len(inputs)
            count += len(inputs)
    return total / count if count else float("nan")


def _check_has_images(shards: Sequence[str | Path]) -> None:
    for path in shards:
        if shard_attributes(path)["labels_only"]:
            raise ModelError(
                f"{path}: holds labels only; add sessions with images to the study before training"
            )


def _validation_split(
    rows: ShardDataset, shards: Sequence[str | Path], study: Study
) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of the rows that train and of those that only watch the loss, by orbit."""
    places = positions_of(rows)
    known = {name: about for path in shards for name, about in shard_attributes(path)["cells"].items()}
    orbit = {name: known.get(name, {}).get("orbit", name) for name in places}
    widths = np.array([study.sensor.width_x_mm, study.sensor.width_y_mm])
    from_wall = {name: float(np.minimum(place, widths - place).min()) for name, place in places.items()}
    split = split_orbits(orbit, from_wall, study.learning.validation_fraction, study.seed + 1)
    sides = ({cell for cell, name in split.items() if name == side} for side in ("train", "test"))
    training, validation = (subset(rows, cells) for cells in sides)
    return training, validation


def shards_digest(shards: Sequence[str | Path]) -> str:
    """Return the digest of the shards that a model is trained on, after checking that they are whole."""
    for path in shards:
        shard_attributes(path)
    return digest([file_sha256(path) for path in shards])


def _settings(study: Study, shards: Sequence[str | Path]) -> dict:
    """Return what the model file tells about its making; plain numbers and text."""
    dump = study.model_dump(mode="json", include={"study", "seed", "learning", "features", "dataset"})
    attributes = [shard_attributes(path) for path in shards]
    sessions = {name: about for one in attributes for name, about in one["sessions"].items()}
    return {
        **dump,
        "bins": study.sensor.bins.model_dump(mode="json"),
        "sensor_width_mm": [study.sensor.width_x_mm, study.sensor.width_y_mm],
        "synthetic": any(one["synthetic"] for one in attributes),
        "views": {name: about["view"] for name, about in sorted(sessions.items()) if about.get("view")},
        "shards_digest": shards_digest(shards),
    }


def _save_checkpoint(path: Path, settings: dict, network, adam, losses: list[tuple]) -> None:
    content = {
        "format": CHECKPOINT_FORMAT,
        "settings": settings,
        "weights": network.state_dict(),
        "adam": adam.state_dict(),
        "losses": [list(row) for row in losses],
    }
    save_tensors(path, content)


def _resume(path: Path, settings: dict, network, adam) -> list[tuple]:
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
    adam.load_state_dict(content["adam"])
    return [(int(epoch), training, validation) for epoch, training, validation in content["losses"]]
