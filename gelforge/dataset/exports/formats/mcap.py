"""MCAP: forces, wrench and images as messages in JSON, for Foxglove and for ROS tools."""

from __future__ import annotations

import base64
import json
from pathlib import Path

from gelforge.dataset.exports.card import card
from gelforge.dataset.exports.export import Export, Options, library
from gelforge.dataset.exports.source import IMAGE, Source, wrench
from gelforge.dataset.schema import DatasetError
from gelforge.files import write_text
from gelforge.progress import tracked

NUMBERS = {"type": "array", "items": {"type": "number"}}
XYZ = {"type": "object", "properties": {axis: {"type": "number"} for axis in "xyz"}}
TIME = {"type": "object", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
PNG, TEXT = b"\x89PNG", {"type": "string"}
TOPICS = {  # topic: name of the schema, its properties
    "/tactile/forces_3d": ("gelforge.ForceDistribution", {"force_N": {"type": "array", "items": NUMBERS}}),
    "/tactile/wrench": ("geometry_msgs/Wrench", {"force": XYZ, "torque": XYZ}),
    "/tactile/state": (
        "gelforge.State",
        {"press": TEXT, "split": TEXT, "phase": TEXT, "position_mm": NUMBERS, "depth_mm": {"type": "number"}},
    ),
    "/tactile/image": (
        "foxglove.CompressedImage",
        {"timestamp": TIME, "frame_id": TEXT, "format": TEXT, "data": TEXT | {"contentEncoding": "base64"}},
    ),
}
USE = """\
```python
import json
from mcap.reader import make_reader

reader = make_reader(open("FOLDER/train.mcap", "rb"))  # or validation.mcap, test.mcap
for schema, channel, message in reader.iter_messages("/tactile/forces_3d"):
    json.loads(message.data)["force_N"]  # {bins} x 3 [N]
```

A message of each topic per row, {fps:g} rows per second, press after press: shards hold no times, these say the order only.
`/tactile/wrench` is in N and N m about the middle of the sensor at z = 0; Foxglove draws `/tactile/image` as it is."""


def write(source: Source, folder: Path, options: Options) -> None:
    """Write a finished file per split."""
    if options.fps <= 0:
        raise DatasetError(f"--fps {options.fps:g}: frames per second are more than 0")
    for split in source.counts:
        _write_split(source, split, folder / f"{split}.mcap", options.fps)
    use = USE.format(bins=source.variables["force_distribution_N"].shape[0], fps=options.fps)
    write_text(folder / "README.md", card(source, use, options))


def _write_split(source: Source, split: str, path: Path, fps: float) -> None:
    writer_of = library("mcap.writer", "mcap").Writer
    with open(path, "wb") as file:
        writer = writer_of(file)
        writer.start(profile="", library="gelforge")
        channels = {}
        for topic, (name, properties) in TOPICS.items():
            schema = json.dumps({"type": "object", "properties": properties}).encode()
            number = writer.register_schema(name=name, encoding="jsonschema", data=schema)
            channels[topic] = writer.register_channel(topic, "json", number)
        about = {"study": source.manifest["study"], "manifest_sha256": source.manifest_sha256}
        writer.add_metadata("gelforge", about | {"synthetic": str(source.manifest["synthetic"]).lower()})
        row = 0
        for press in tracked(source.of_split(split), f"indentations of {split} exported"):
            for messages in _messages(source, press, fps, row):
                time = round(row / fps * 1e9)
                for topic, content in messages.items():
                    data = json.dumps(content, allow_nan=False).encode()
                    writer.add_message(channels[topic], time, data, time)
                row += 1
        writer.finish()


def _messages(source: Source, press, fps: float, start: int):
    """Yield the messages of each row of an indentation by topic."""
    rows = source.read([press])
    resultant = wrench(rows["force_distribution_N"], rows["total_force_fem_N"], source.sensor)
    for i in range(len(press.rows)):
        topics = {
            "/tactile/forces_3d": {"force_N": rows["force_distribution_N"][i].tolist()},
            "/tactile/state": {
                "press": press.name,
                "split": press.split,
                "phase": rows["phase"][i],
                "position_mm": rows["position_mm"][i].tolist(),
                "depth_mm": float(rows["depth_mm"][i]),
            },
        }
        if resultant is not None:
            force, torque = resultant[i, :3].tolist(), (resultant[i, 3:] / 1000).tolist()
            topics["/tactile/wrench"] = {"force": dict(zip("xyz", force)), "torque": dict(zip("xyz", torque))}
        if source.images:
            sec, nsec = divmod(round((start + i) / fps * 1e9), 10**9)
            content = rows[IMAGE][i]
            topics["/tactile/image"] = {
                "timestamp": {"sec": sec, "nsec": nsec},
                "frame_id": "camera",
                "format": "png" if content.startswith(PNG) else "jpeg",
                "data": base64.b64encode(content).decode(),
            }
        yield topics


EXPORT = Export(
    "mcap",
    "a file per split with forces, wrench, state and image of each row in JSON: Foxglove, `mcap.reader`",
    write,
)
