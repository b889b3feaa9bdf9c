"""The card (README.md) of an export, and what its first lines say to a hub."""

from __future__ import annotations

import json

from gelforge.dataset.card import (
    SPLIT,
    SYNTHETIC,
    failures_text,
    interpolated_text,
    label_text,
    sessions_text,
)
from gelforge.dataset.exports.export import Options
from gelforge.dataset.exports.source import Source

# The size categories of a dataset card (Hugging Face Hub, docs/hub/datasets-cards).
SIZES = ((1e3, "n<1K"), (1e4, "1K<n<10K"), (1e5, "10K<n<100K"), (1e6, "100K<n<1M"))


def title(source: Source) -> str:
    """Return the name under which an export is shown."""
    return f"Force distributions of study {source.manifest['study']}"


def card(source: Source, use: str, options: Options, columns: str | None = None) -> str:
    """Return the card as Markdown; use: how the format is loaded; columns: what it holds, if not the rows' columns."""
    manifest, rows = source.manifest, sum(source.counts.values())
    counts = ", ".join(f"{count} {split}" for split, count in source.counts.items())
    licence = f"Licence: {options.licence}." if options.licence else "No licence is granted by this card."
    parts = [
        f"# {title(source)}",
        SYNTHETIC if manifest["synthetic"] else "",
        f"{rows} rows ({counts}) of {len(source.presses)} {'cells' if manifest['labels_only'] else 'presses'}. "
        + ("" if rows == len(source.rows) else f"A sample: the whole dataset has {len(source.rows)} rows."),
        "## Loading",
        use,
        "## Label",
        label_text(source.sensor),
        interpolated_text(manifest),
        "## Split",
        f"{SPLIT} `validation` is drawn from the training sites in the same way.",
        "## Columns",
        columns or columns_table(source),
        "## Sessions",
        sessions_text(manifest),
        "## Failed sites",
        failures_text(manifest),
        "## Provenance",
        f"Made by gelforge {manifest['code_version']} from the dataset of study `{manifest['study']}` whose manifest.json "
        f"has the SHA-256 `{source.manifest_sha256}`; `sha256sum -c SHA256SUMS` verifies what lies here. {licence}",
    ]
    return "\n\n".join(part.strip() for part in parts if part) + "\n"


def columns_table(source: Source) -> str:
    """Return the columns of the rows as a table."""
    lines = [
        f"| `{name}` | {variable.kind} {list(variable.shape) or ''} | {variable.unit} | {variable.description} |"
        for name, variable in source.variables.items()
    ]
    return "| column | type | unit | what |\n|---|---|---|---|\n" + "\n".join(lines)


def front_matter(source: Source, options: Options, configs: list[dict[str, str]]) -> str:
    """Return the lines in YAML that a hub reads before the card; configs: split and path of its files."""
    rows = sum(source.counts.values())
    tags = ["tactile", "force", "finite-elements", *(["synthetic"] if source.manifest["synthetic"] else [])]
    size = next((name for limit, name in SIZES if rows < limit), "1M<n<10M")
    return "\n".join(
        [
            "---",
            *([f"license: {json.dumps(options.licence)}"] if options.licence else []),
            f"pretty_name: {json.dumps(title(source))}",
            f"tags: {json.dumps(tags)}",
            f"size_categories: {json.dumps([size])}",
            "configs:",
            "- config_name: default",
            "  data_files:",
            *(f"  - split: {one['split']}\n    path: {json.dumps(one['path'])}" for one in configs),
            "---",
            "",
            "",
        ]
    )
