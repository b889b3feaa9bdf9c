"""Croissant 1.1: the Parquet files of the Hugging Face format with a description that machines read."""

from __future__ import annotations

from pathlib import Path

from gelforge.dataset.card import croissant_metadata, file_object, summary
from gelforge.dataset.exports.card import title
from gelforge.dataset.exports.export import Export, Options
from gelforge.dataset.exports.formats import huggingface
from gelforge.dataset.exports.source import Source, Variable
from gelforge.files import file_sha256, write_json

FILES, PARQUET = "parquet-files", "application/x-parquet"
TYPES = {
    "f4": "cr:Float32",
    "f8": "cr:Float64",
    "i4": "cr:Int32",
    "bool": "sc:Boolean",
    "text": "sc:Text",
    "image": "sc:ImageObject",
}


def write(source: Source, folder: Path, options: Options) -> None:
    """Write the Hugging Face folder and croissant.json with the record sets `splits` and `rows`."""
    huggingface.write(source, folder, options)
    write_json(folder / "croissant.json", metadata(source, folder, options))


def metadata(source: Source, folder: Path, options: Options) -> dict:
    """Return the JSON-LD of a folder that holds the Parquet files already."""
    files = sorted((folder / "data").glob("*.parquet"))
    objects = [
        file_object(path.name, path.stat().st_size, PARQUET, file_sha256(path), "data/") for path in files
    ]
    together = _node("FileSet", FILES, "all rows", encodingFormat=PARQUET, includes="data/*.parquet")
    return croissant_metadata(
        source.manifest["study"], summary(source.manifest), options.licence, options.published
    ) | {
        "alternateName": title(source),
        "distribution": [*objects, together],
        "recordSet": [_splits(source), _rows(source)],
    }


def _node(kind: str, identity: str, description: str, **more) -> dict:
    """Return a node of the JSON-LD; its name is the last part of its identity."""
    name = identity.rpartition("/")[2]
    return {"@type": f"cr:{kind}", "@id": identity, "name": name, "description": description, **more}


def _splits(source: Source) -> dict:
    """Return the record set that names the splits."""
    return _node(
        "RecordSet",
        "splits",
        "the splits that have rows, by orbit: a site with its mirror images",
        dataType="cr:Split",
        key={"@id": "splits/name"},
        field=[_node("Field", "splits/name", "name of the split", dataType="sc:Text")],
        data=[{"splits/name": split} for split in source.counts],
    )


def _rows(source: Source) -> dict:
    """Return the record set of all rows; the field `rows/split` says which split each belongs to."""
    fields = [_field(name, variable) for name, variable in source.variables.items()]
    return _node("RecordSet", "rows", "one sample per record", field=fields)


def _field(name: str, variable: Variable) -> dict:
    image = variable.kind == "image"
    extract: dict = {"fileSet": {"@id": FILES}, "extract": {"column": name}}
    field = _node(
        "Field",
        f"rows/{name}",
        f"{variable.description} [{variable.unit}]",
        dataType=TYPES[variable.kind],
        source=extract | ({"transform": {"jsonPath": "bytes"}} if image else {}),
    )
    if variable.shape and not image:
        field |= {"isArray": True, "arrayShape": ",".join(map(str, variable.shape))}
    if name == "split":
        field["references"] = {"field": {"@id": "splits/name"}}
    return field


EXPORT = Export(
    "croissant",
    "the files of `huggingface` and `croissant.json` (Croissant 1.1, record sets `splits` and `rows`): "
    '`mlcroissant.Dataset(jsonld=FOLDER/croissant.json).records("rows")`',
    write,
)
