"""The dataset's card (README.md) and its Croissant description."""

from __future__ import annotations

from gelforge import __version__
from gelforge.config import Sensor, Study
from gelforge.dataset.schema import columns
from gelforge.indentation.sensor.unrolled import is_unrolled

SYNTHETIC = (
    "> **SYNTHETIC RECORDINGS.** The images and force readings of this dataset were made by a virtual lab, not measured.\n"
    "> They show that the software works from end to end; they say nothing about a real sensor.\n"
)
# Shards hold all splits. Hugging Face's loader would call them `train`.
FRONT_MATTER = """\
---
configs:
- config_name: default
  data_files:
  - split: unsplit
    path: shard-*.h5
---

"""
CROISSANT_CONTEXT = {  # of Croissant 1.1
    "@language": "en",
    "@vocab": "https://schema.org/",
    **{
        name: f"cr:{name}"
        for name in (
            "arrayShape citeAs column containedIn equivalentProperty extract field fileObject fileProperty fileSet format "
            "includes isArray isLiveDataset jsonPath key md5 parentField path recordSet references regex repeated replace "
            "samplingRate separator source subField transform"
        ).split()
    },
    "conformsTo": "dct:conformsTo",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "rai": "http://mlcommons.org/croissant/RAI/",
    "sc": "https://schema.org/",
}
METHOD = (
    "Sferrazza et al., Ground truth force distribution for learning-based tactile sensing: a finite element approach, "
    "IEEE Access 2019, doi 10.1109/ACCESS.2019.2956882"
)
SPLIT = (
    "By site, so that no image of an indentation is on both sides. Where the plan has mirror images, a held-out site's"
    " label may mirror a training site's; its images do not."
)
LOADING = """\
```python
import torch
from gelforge import load_dataset

rows = load_dataset("FOLDER", "train")  # this folder; or "validation", "test"; without a split: all three by name
row = rows[0]  # a dict of tensors; names of sites and indentations are text
row["force_distribution_N"].shape  # (bins, 3) [N]
loader = torch.utils.data.DataLoader(rows, batch_size=64, shuffle=True)
for batch in loader:
    batch["force_distribution_N"].shape  # (64, bins, 3) [N]
```

`validation` holds the training rows on which gelforge monitors the loss. `gelforge export dataset` writes other
formats."""


def card(study: Study, manifest: dict) -> str:
    """Return the dataset card as Markdown; synthetic data and datasets of labels only say so first."""
    rows = manifest["rows"]
    splits = [cell["split"] for cell in manifest["cells"].values() if cell["status"] == "converged"]
    parts = [
        f"# Force distributions of study {study.study}",
        SYNTHETIC if manifest["synthetic"] else "",
        "**Labels only:** the study has no recordings with images, so there are no features.\n"
        if manifest["labels_only"]
        else "",
        f"{rows['all']} rows ({rows['train']} train, {rows['test']} test) of {len(splits)} sites "
        f"({splits.count('train')} train, {splits.count('test')} test) in {len(manifest['shards'])} shards. "
        f"A site is one position with all its depths.",
        "## Loading",
        LOADING,
        "## Label",
        label_text(study.sensor),
        interpolated_text(manifest),
        "## Split",
        SPLIT,
        "## Columns",
        "| dataset | type | unit | what |\n|---|---|---|---|\n"
        + "\n".join(
            f"| `{name}` {_shape(column.shape)} | {column.kind} | {column.unit} | {column.description} |"
            for name, column in columns(manifest["labels_only"]).items()
        ),
        "## Sessions",
        sessions_text(manifest),
        "## Failed sites",
        failures_text(manifest),
        "## Provenance",
        "`manifest.json` names every shard, site, feature file and raw file with its SHA-256 and all settings; "
        "`sha256sum -c SHA256SUMS` verifies what lies here. Axis 0 is the sample in every dataset of every shard. "
        f"Made by gelforge {manifest['code_version']}. No licence is granted by this card: "
        "the owner of the recordings states it.",
    ]
    return FRONT_MATTER + "\n\n".join(part.strip() for part in parts if part) + "\n"


def label_text(sensor: Sensor) -> str:
    """Return what the label of a sensor is."""
    bins = sensor.bins
    unrolled = (
        " Bins have equal areas of the dome's surface, which is unrolled to the rectangle around it "
        "(gelforge/indentation/sensor/unrolled.py)."
    )
    return (
        f"The three-dimensional contact force on each of {bins.nx} x {bins.ny} bins of the undeformed surface "
        f"({sensor.width_x_mm:g} x {sensor.width_y_mm:g} mm), from a finite-element model ({METHOD}). Bin "
        f"k = {bins.nx} iy + ix.{unrolled if is_unrolled(sensor) else ''} "
        "Frame: x, y along the edges with the origin at a corner of the top surface, z up; a "
        "pressing ball gives negative Fz. Units: mm, N. The label is a simulation's result, not a measurement; measured "
        "total forces are given too where there are recordings."
    )


def interpolated_text(manifest: dict) -> str:
    """Return which labels are interpolated; "" where none is."""
    between = [cell for cell in manifest["cells"].values() if cell.get("interpolated_from")]
    if not between:
        return ""
    return (
        f"Labels of {len(between)} sites are interpolated between solved sites, which `manifest.json` names by site "
        "(`interpolated_from`); their error bars include the error of the interpolation."
    )


def _shape(shape: tuple[str, ...]) -> str:
    return f"({', '.join(('N', *shape))})"


def sessions_text(manifest: dict) -> str:
    """Return the sessions as a list: synthetic or measured, and whose labels."""
    lines = [
        f"- `{name}`: {'SYNTHETIC' if session.get('synthetic') else 'measured'}{_labels_of(session)}"
        for name, session in sorted(manifest["sessions"].items())
    ]
    return "\n".join(lines) or "None."


def _labels_of(session: dict) -> str:
    """Return in words where the labels of a session are from, if not from the plan's sites."""
    if "presses" in session:
        return "; each indentation has its own label, softened by the earlier ones"
    return "; labels at the sensor's age and temperature in this session" if "cells" in session else ""


def failures_text(manifest: dict) -> str:
    """Return sites of the plan that failed, then those of sessions and their indentations, with the reason."""
    failed = sorted(manifest["failed_cells"].items())
    for name, session in sorted(manifest["sessions"].items()):
        for kind in ("failed_cells", "failed_presses"):
            failed += [(f"{name}/{what}", reason) for what, reason in sorted(session.get(kind, {}).items())]
    return "\n".join(f"- `{name}`: {reason}" for name, reason in failed) or "None."


def croissant(study: Study, manifest: dict) -> dict:
    """Return the Croissant 1.1 JSON-LD description: one HDF5 FileObject per shard, and the columns as variables.

    Croissant has no way yet to extract records from HDF5, so no record set is declared; `gelforge export dataset --format
    croissant` writes Parquet and declares them.
    """
    return croissant_metadata(study.study, summary(manifest)) | {
        "distribution": [
            file_object(shard["file"], shard["bytes"], "application/x-hdf5", shard["sha256"])
            for shard in manifest["shards"]
        ],
        "variableMeasured": [
            {
                "@type": "sc:PropertyValue",
                "name": name,
                "unitText": column.unit,
                "description": column.description,
            }
            for name, column in columns(manifest["labels_only"]).items()
        ],
    }


def summary(manifest: dict) -> str:
    """Return in a sentence what a dataset holds."""
    kind = "SYNTHETIC recordings of a virtual lab" if manifest["synthetic"] else "measured recordings"
    what = "labels only, no recordings" if manifest["labels_only"] else kind
    return f"Contact force distributions of a soft tactile sensor from finite elements; {what}."


def file_object(name: str, size: int, encoding: str, sha256: str, folder: str = "") -> dict:
    """Return Croissant's description of a file in a folder of the dataset; folder: with its slash."""
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "contentUrl": f"{folder}{name}",
        "contentSize": f"{size} B",
        "encodingFormat": encoding,
        "sha256": sha256,
    }


def croissant_metadata(
    name: str, description: str, licence: str | None = None, published: str | None = None
) -> dict:
    """Return what a Croissant 1.1 description says of a dataset as a whole; licence and ISO date where they are known."""
    known = {"license": licence, "datePublished": published}
    return {
        "@context": CROISSANT_CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": "http://mlcommons.org/croissant/1.1",
        "name": name,
        "description": description,
        "version": __version__,
        "citeAs": METHOD,
        **{key: value for key, value in known.items() if value},
    }
