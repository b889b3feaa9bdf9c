"""What a smaller image costs the network and saves in time: features.image_scale and flow_preset on a finished study.

usage: python benchmarks/image_size.py [results/benchmark] [--cases 1:fine 0.8:fine 0.5:full] [--seeds 1] [--work FOLDER]
       (one thread; two to four minutes for the features of a case, three for a training; --work keeps features)

The features of every session are made anew for each case, image_scale:flow_preset; rows, labels and split are those of the
study's shards. Prints a Markdown table: medians over seeds of the errors on the test rows, and CPU milliseconds in which one
image becomes features.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
import json  # noqa: E402
import tempfile  # noqa: E402
import time  # noqa: E402
from pathlib import Path  # noqa: E402

import cv2  # noqa: E402
import h5py  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from networks import judged  # noqa: E402

from gelforge.cli.products.sessions import image_sessions, recording_of  # noqa: E402
from gelforge.config import Features, Learning, Study, load_study  # noqa: E402
from gelforge.dataset.schema import columns  # noqa: E402
from gelforge.dataset.shard import ShardDataset, shard_attributes, writing_shard  # noqa: E402
from gelforge.recording.features import FlowFeatures, session_features  # noqa: E402
from gelforge.recording.imaging.flow import read_grey  # noqa: E402
from gelforge.recording.imaging.images import image_path, reference_path  # noqa: E402
from gelforge.recording.optics.remap import picture_of, read_as  # noqa: E402

TIMED = 200  # images


def made_features(study: Study, folder: Path) -> dict[str, Path]:
    """Return the file of features of each session, made unless it is there."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {name: folder / f"{name}.h5" for name in image_sessions(study)}
    for name, path in files.items():
        if not path.exists():
            session_features(recording_of(study, name), study.features, path)
    return files


def with_features(shard: Path, files: dict[str, Path], out: Path) -> None:
    """Write a shard again with the features of files (by session): each row has those of its image."""
    about, rows = shard_attributes(shard), ShardDataset([shard])
    block = rows.read(np.arange(len(rows)), list(columns(labels_only=False)))
    for session, path in files.items():
        mine = np.flatnonzero(block["session"] == session)
        with h5py.File(path) as file:
            row_of = {name: row for row, name in enumerate(file["image"].asstr()[:])}
            block["feature"][mine] = file["feature"][:][[row_of[name] for name in block["image"][mine]]]
            about["sessions"][session]["view"] = json.loads(file.attrs["view"])
    sizes = block["feature"].shape[1], block["force_distribution_N"].shape[1]
    with writing_shard(out, about, False, *sizes) as writer:
        writer.append(block)


def cost(study: Study, session: str) -> float:
    """Return the median CPU time [ms] in which an image becomes features: reduced, searched, averaged."""
    recording = recording_of(study, session)
    picture = picture_of(recording.session, study.features.image_scale)
    extract = FlowFeatures(read_as(picture, reference_path(recording.folder)), study.features)
    names = [name for name in recording.readings["image"] if name][:TIMED]
    seconds = []
    for image in [read_grey(image_path(recording.folder, name)) for name in names]:
        start = time.thread_time()
        extract(picture(image))
        seconds.append(time.thread_time() - start)
    return 1e3 * float(np.median(seconds))


def remade(study: Study, shards: list[Path], folder: Path) -> list[Path]:
    """Return shards with the study's features, made unless they are there."""
    files = made_features(study, folder)
    ours = [folder / shard.name for shard in shards]
    for shard, path in zip(shards, ours):
        if not path.exists():
            with_features(shard, files, path)
    return ours


def row_at(study: Study, ours: list[Path], seeds: list[int], folder: Path) -> dict[str, float]:
    """Return a table's row of shards with the study's features: medians over seeds of the errors, and time."""
    session = next(iter(image_sessions(study)))
    errors = []
    for seed in seeds:
        with tempfile.TemporaryDirectory() as run:
            errors.append(judged(study.model_copy(update={"seed": seed}), ours, Path(run)))
        print(
            f"{folder.name}, seed {seed}: {', '.join(f'{k} {v:.3g}' for k, v in errors[-1].items())}",
            flush=True,
        )
    return {**pd.DataFrame(errors).median(), "image to features, CPU [ms]": cost(study, session)}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="?", type=Path, default=Path("results/benchmark"))
    parser.add_argument("--cases", nargs="+", default=["1:fine", "0.8:fine", "0.6:fine", "0.5:full"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument(
        "--work", type=Path, default=Path("results/image_size"), help="folder of features and shards"
    )
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    study = load_study(arguments.results / "study.yaml")
    shards = sorted((arguments.results / "dataset").glob("shard-*.h5"))
    learning = Learning(validation_fraction=study.learning.validation_fraction)
    table = {}
    for case in arguments.cases:
        scale, preset = case.split(":")
        asked = {"image_scale": float(scale), "flow_preset": preset}
        features = Features(**study.features.model_dump() | asked)
        changed = study.model_copy(update={"learning": learning, "features": features})
        folder = arguments.work / case.replace(":", "-")
        ours = shards if features == study.features else remade(changed, shards, folder)
        table[case] = row_at(changed, ours, arguments.seeds, folder)
    print()
    print(pd.DataFrame(table).to_markdown(floatfmt=".3g"))


if __name__ == "__main__":
    main()
