"""Rows as Parquet, with the types that the `datasets` library reads from the file's metadata."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from gelforge.dataset.exports.export import library
from gelforge.dataset.exports.source import Variable

# Uncompressed: below the MAX_SHARD_SIZE of `datasets`, 500 MB (datasets/config.py).
FILE_BYTES = 400e6
TYPES = {"f4": "float32", "f8": "float64", "i4": "int32", "i8": "int64", "bool": "bool", "text": "string"}


def feature(variable: Variable) -> dict:
    """Return a column's type as `datasets.Features` has it in JSON."""
    if variable.kind == "image":
        return {"_type": "Image"}
    if len(variable.shape) > 1:
        return {
            "shape": list(variable.shape),
            "dtype": TYPES[variable.kind],
            "_type": f"Array{len(variable.shape)}D",
        }
    value = {"dtype": TYPES[variable.kind], "_type": "Value"}
    if variable.shape:
        return {"feature": value, "length": variable.shape[0], "_type": "Sequence"}
    return value


def schema(variables: Mapping[str, Variable]):
    """Return the Arrow schema of some columns."""
    pa = library("pyarrow")
    features = {name: feature(variable) for name, variable in variables.items()}
    about = {name: {"unit": v.unit, "description": v.description} for name, v in variables.items()}
    metadata = {"huggingface": json.dumps({"info": {"features": features}}), "gelforge": json.dumps(about)}
    return pa.schema([(name, _type(variable)) for name, variable in variables.items()], metadata=metadata)


def _type(variable: Variable):
    pa = library("pyarrow")
    if variable.kind == "image":
        return pa.struct([("bytes", pa.binary()), ("path", pa.string())])
    kind = {"bool": pa.bool_(), "text": pa.string()}.get(variable.kind)
    kind = kind or pa.from_numpy_dtype(np.dtype(TYPES[variable.kind]))
    if len(variable.shape) == 1:
        return pa.list_(kind, variable.shape[0])
    for _ in variable.shape:
        kind = pa.list_(kind)
    return kind


def table(block: Mapping[str, np.ndarray], variables: Mapping[str, Variable]):
    """Return a block of rows as an Arrow table."""
    pa = library("pyarrow")
    arrays = [_array(block[name], variable) for name, variable in variables.items()]
    return pa.table(arrays, schema=schema(variables))


def _array(values, variable: Variable):
    pa = library("pyarrow")
    if variable.kind == "image":
        return pa.array([{"bytes": content, "path": None} for content in values], _type(variable))
    if variable.kind == "text":
        return pa.array(list(values), pa.string())
    values = np.ascontiguousarray(values, TYPES[variable.kind])
    array = pa.array(values.ravel())
    if len(variable.shape) == 1:
        return pa.FixedSizeListArray.from_arrays(array, variable.shape[0])
    for axis in range(len(variable.shape), 0, -1):
        count = int(np.prod(values.shape[:axis]))
        ends = np.arange(count + 1, dtype=np.int32) * values.shape[axis]
        array = pa.ListArray.from_arrays(pa.array(ends), array)
    return array


def write_files(
    blocks: Iterable[Mapping],
    variables: Mapping[str, Variable],
    path_of: Callable[[int], str | Path],
    limit: float = FILE_BYTES,
) -> list[int]:
    """Write blocks of rows as row groups into files that end after about `limit` bytes; return each block's file by number.

    path_of: the path of a file by its number, from 0. Every file is finished when this returns.
    """
    pq = library("pyarrow.parquet", "pyarrow")
    numbers: list[int] = []
    number, size = -1, float("inf")
    with ExitStack() as open_file:
        for block in blocks:
            if size >= limit:
                open_file.close()
                number, size = number + 1, 0
                path = Path(path_of(number))
                path.parent.mkdir(parents=True, exist_ok=True)
                writer = pq.ParquetWriter(path, schema(variables), **_encoding(variables))
                open_file.enter_context(writer)
            writer.write_table(table(block, variables))
            size += block_bytes(block)
            numbers.append(number)
    return numbers


def _encoding(variables: Mapping[str, Variable]) -> dict:
    """Return how columns are stored: numbers byte by byte, which takes half of what dictionaries of them take."""
    numbers = [
        name + ".list.element" * len(v.shape) for name, v in variables.items() if v.kind in ("f4", "f8")
    ]
    text = [name for name, variable in variables.items() if variable.kind == "text"]
    return {"compression": "zstd", "use_dictionary": text, "use_byte_stream_split": numbers}


def block_bytes(block: Mapping) -> int:
    """Return about how many bytes a block of rows takes uncompressed."""
    return sum(
        sum(map(len, values)) if isinstance(values, list) else values.nbytes for values in block.values()
    )
