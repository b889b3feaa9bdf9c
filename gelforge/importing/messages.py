"""Messages of one topic of a ROS 1 or ROS 2 bag or an MCAP file, and tables of their fields.

MCAP files are read with `mcap` (JSON and Protobuf as they are, ROS messages with the types of `rosbags`), bags with
`rosbags`; both come with the extra `bags` and are imported when a mapping names such a file.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pandas as pd

from gelforge.importing.refusals import ImportingError, library

SUFFIXES = {".bag", ".mcap", ".db3"}
RECEIVED = "received"  # the column that is not a field: when the message was recorded


def is_bag(path: Path) -> bool:
    """Return whether a file or folder holds messages of topics."""
    return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


def message_table(
    path: Path, topic: str | None, columns: list[str], frame_id: str | None, key: str
) -> pd.DataFrame:
    """Return fields of the messages of a topic, a row each, by their dotted names; stamps in s, `received` likewise.

    Raises ImportingError for a field that is missing or no number, and where the messages are of several frames.
    """
    rows, frames = [], set()
    for received, message in messages(path, topic, key):
        frame = _frame_id(message)
        if frame_id is not None and frame != frame_id:
            frames.add(frame)
            continue
        frames.add(frame)
        rows.append(
            [received if name == RECEIVED else _number_in(message, name, path, topic) for name in columns]
        )
    if frame_id is None and len(frames) > 1:
        raise ImportingError(
            f"{path}: the messages of {topic} are of the frames {', '.join(sorted(frames))}; choose one by {key}.frame_id"
        )
    if not rows:
        raise ImportingError(
            f"{path}: no message of {topic}"
            + (f" is of the frame {frame_id!r}, there are {', '.join(sorted(frames))}" if frames else "")
            + f"; correct {key}.{'frame_id' if frames else 'topic'}"
        )
    return pd.DataFrame(rows, columns=columns, index=range(1, len(rows) + 1))


def messages(path: Path, topic: str | None, key: str) -> Iterator[tuple[float, Any]]:
    """Yield when each message of a topic was recorded [s], and the message: an object or a dictionary."""
    if not path.exists():
        raise ImportingError(f"{path}: no such bag; correct {key}.file")
    return _mcap(path, topic, key) if path.suffix.lower() == ".mcap" else _bag(path, topic, key)


def field(message: Any, name: str) -> Any:
    """Return a field by its dotted name; numbers count into arrays. Raises LookupError where there is none."""
    for part in name.split("."):
        if isinstance(message, dict):
            message = message[part]
        elif part.isdecimal():
            message = message[int(part)]
        elif hasattr(message, part):
            message = getattr(message, part)
        else:
            raise LookupError(part)
    return message


def _number_in(message: Any, name: str, path: Path, topic: str | None) -> float:
    try:
        value = field(message, name)
        return seconds(value) if _is_stamp(value) else float(value)
    except (LookupError, TypeError, ValueError):
        raise ImportingError(
            f"{path}: a message of {topic} has no number {name!r}, its fields are {', '.join(_names(message))}; name a field"
            " with dots, as wrench.force.x"
        ) from None


STAMPS = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"))  # ROS, Foxglove's JSON, Protobuf


def _is_stamp(value: Any) -> bool:
    return any(all(_has(value, part) for part in parts) for parts in STAMPS)


def seconds(stamp: Any) -> float:
    """Return a stamp of whole seconds and nanoseconds [s]."""
    secs, rest = next(parts for parts in STAMPS if all(_has(stamp, part) for part in parts))
    return int(field(stamp, secs)) + 1e-9 * int(field(stamp, rest))


def _has(value: Any, part: str) -> bool:
    return part in value if isinstance(value, dict) else hasattr(value, part)


def _names(message: Any) -> list[str]:
    if isinstance(message, dict):
        return list(message)
    if hasattr(message, "DESCRIPTOR"):
        return [entry.name for entry in message.DESCRIPTOR.fields]
    return (
        [name for name in vars(message) if not name.startswith("_")] if hasattr(message, "__dict__") else []
    )


def _frame_id(message: Any) -> str:
    for name in ("header.frame_id", "frame_id"):
        try:
            return str(field(message, name))
        except LookupError:
            continue
    return ""


def _refuse_topic(path: Path, topic: str | None, there: dict[str, str], key: str) -> None:
    if topic not in there:
        have = ", ".join(f"{name} ({kind})" for name, kind in sorted(there.items())) or "none"
        said = "no topic is named" if topic is None else f"no topic {topic}"
        raise ImportingError(f"{path}: {said}, it holds {have}; set {key}.topic")


def _bag(path: Path, topic: str | None, key: str) -> Iterator[tuple[float, Any]]:
    """Yield the messages of a bag of ROS 1 (a file) or ROS 2 (a folder with metadata.yaml)."""
    reader_of = library("rosbags.highlevel", "rosbags", str(path)).AnyReader
    folder = path.parent if path.suffix == ".db3" else path  # what metadata.yaml describes is the folder
    try:
        with reader_of([folder]) as reader:
            _refuse_topic(
                path, topic, {name: info.msgtype or "" for name, info in reader.topics.items()}, key
            )
            wanted = [connection for connection in reader.connections if connection.topic == topic]
            for connection, stamp, raw in reader.messages(connections=wanted):
                yield stamp * 1e-9, reader.deserialize(raw, connection.msgtype)
    except (ImportingError, GeneratorExit):
        raise
    except Exception as error:  # the library raises many kinds, of its own and of SQLite's
        raise ImportingError(
            f"{path}: cannot be read as a bag ({str(error).splitlines()[0] if str(error) else type(error).__name__});"
            " copy it again, a bag that was cut short is repaired by `rosbag reindex` or `ros2 bag reindex`"
        ) from None


def _mcap(path: Path, topic: str | None, key: str) -> Iterator[tuple[float, Any]]:
    reader_of = library("mcap.reader", "mcap", str(path)).make_reader
    decoders: dict[int, Callable[[bytes], Any]] = {}
    with open(path, "rb") as file:
        try:
            reader = reader_of(file)
            summary = reader.get_summary()
            if summary is None:
                raise ImportingError(
                    f"{path}: has no summary, it was cut short; repair it with `mcap recover`"
                )
            schemas = {number: schema.name for number, schema in summary.schemas.items()}
            there = {c.topic: schemas.get(c.schema_id, "") for c in summary.channels.values()}
            _refuse_topic(path, topic, there, key)
            for schema, channel, message in reader.iter_messages(topics=[topic]):
                if channel.id not in decoders:
                    decoders[channel.id] = _decoder(path, schema, channel)
                yield message.log_time * 1e-9, decoders[channel.id](message.data)
        except (ImportingError, GeneratorExit):
            raise
        except Exception as error:  # the library's own, and those of the decoders
            raise ImportingError(
                f"{path}: cannot be read as MCAP ({str(error).splitlines()[0] if str(error) else type(error).__name__});"
                " copy it again, one that was cut short is repaired by `mcap recover`"
            ) from None


def _decoder(path: Path, schema, channel) -> Callable[[bytes], Any]:
    """Return what turns the bytes of a channel's messages into a dictionary or an object."""
    if channel.message_encoding == "json":
        return json.loads
    if channel.message_encoding == "protobuf":
        return _protobuf(path, schema)
    if channel.message_encoding in ("cdr", "ros1"):
        types = library("rosbags.typesys", "rosbags", str(path))
        store = types.get_typestore(types.Stores.EMPTY)
        store.register(types.get_types_from_msg(schema.data.decode(), _ros_name(schema.name)))
        read = store.deserialize_cdr if channel.message_encoding == "cdr" else store.deserialize_ros1
        return lambda data: read(data, _ros_name(schema.name))
    raise ImportingError(
        f"{path}: the messages of {channel.topic} are encoded as {channel.message_encoding!r};"
        " json, protobuf, cdr and ros1 are read"
    )


def _ros_name(name: str) -> str:
    """Return the name of a type with the part `msg`, as ROS 2 has it: `pkg/Type` is `pkg/msg/Type`."""
    parts = name.split("/")
    return f"{parts[0]}/msg/{parts[1]}" if len(parts) == 2 else name


def _protobuf(path: Path, schema) -> Callable[[bytes], Any]:
    library("google.protobuf", "protobuf", str(path))
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name)).FromString
