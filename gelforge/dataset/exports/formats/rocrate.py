"""RO-Crate 1.1: the Parquet files of the Hugging Face format with a research object's description."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from gelforge import __version__
from gelforge.dataset.card import METHOD, summary
from gelforge.dataset.exports.card import title
from gelforge.dataset.exports.export import Export, Options
from gelforge.dataset.exports.formats import huggingface
from gelforge.dataset.exports.source import Source
from gelforge.files import file_sha256, write_json

FILE = "ro-crate-metadata.json"
TOOL, ACTION = "#gelforge", "#export"
UNKNOWN = "No licence is granted: the owner of the recordings states it."


def write(source: Source, folder: Path, options: Options) -> None:
    """Write the Hugging Face folder and ro-crate-metadata.json."""
    huggingface.write(source, folder, options)
    write_json(folder / FILE, metadata(source, folder, options))


def metadata(source: Source, folder: Path, options: Options) -> dict:
    """Return the JSON-LD of a folder that holds its files already; without a date that of the dataset's manifest."""
    made = (source.folder / "manifest.json").stat().st_mtime
    published = options.published or datetime.fromtimestamp(made, UTC).date().isoformat()
    paths = sorted(path for path in folder.rglob("*") if path.is_file())
    files = [
        {
            "@id": path.relative_to(folder).as_posix(),
            "@type": "File",
            "name": path.name,
            "contentSize": str(path.stat().st_size),
            "encodingFormat": "text/markdown" if path.suffix == ".md" else "application/vnd.apache.parquet",
            "sha256": file_sha256(path),
        }
        for path in paths
    ]
    columns = [
        {
            "@id": f"#{name}",
            "@type": "PropertyValue",
            "name": name,
            "unitText": variable.unit,
            "description": variable.description,
        }
        for name, variable in source.variables.items()
    ]
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": title(source),
        "description": summary(source.manifest),
        "datePublished": published,
        "license": options.licence or UNKNOWN,
        "isBasedOn": f"urn:sha256:{source.manifest_sha256}",
        "citation": METHOD,
        "hasPart": [{"@id": one["@id"]} for one in files],
        "variableMeasured": [{"@id": one["@id"]} for one in columns],
    }
    descriptor = {
        "@id": FILE,
        "@type": "CreativeWork",
        "about": {"@id": "./"},
        "conformsTo": {"@id": "https://w3id.org/ro/crate/1.1"},
    }
    tool = {"@id": TOOL, "@type": "SoftwareApplication", "name": "gelforge", "version": __version__}
    action = {
        "@id": ACTION,
        "@type": "CreateAction",
        "name": "export of the dataset",
        "instrument": {"@id": TOOL},
        "result": {"@id": "./"},
    }
    graph = [descriptor, root, *files, *columns, tool, action]
    return {"@context": "https://w3id.org/ro/crate/1.1/context", "@graph": graph}


EXPORT = Export(
    "rocrate",
    "the files of `huggingface` and `ro-crate-metadata.json` (RO-Crate 1.1): `rocrate.rocrate.ROCrate(FOLDER)`",
    write,
)
