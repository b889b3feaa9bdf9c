"""Hugging Face `datasets`: `load_dataset(folder)` gives train, validation and test."""

from __future__ import annotations

from pathlib import Path

from gelforge.dataset.exports.card import card, front_matter
from gelforge.dataset.exports.export import Export, Options
from gelforge.dataset.exports.parquet import write_files
from gelforge.dataset.exports.source import Source
from gelforge.files import write_text

USE = """\
```python
from datasets import load_dataset

dataset = load_dataset("FOLDER").with_format("torch")  # this folder, or its name on a hub
row = dataset["train"][0]                              # or validation, test
row["force_distribution_N"]                            # {label} [N]
```"""


def write(source: Source, folder: Path, options: Options) -> None:
    """Write the card and each split's Parquet files."""
    write_data(source, folder)
    label = source.variables["force_distribution_N"].shape
    front = front_matter(
        source,
        options,
        configs=[{"split": split, "path": f"data/{split}-*.parquet"} for split in source.counts],
    )
    write_text(folder / "README.md", front + card(source, USE.format(label=label), options))


def write_data(source: Source, folder: Path) -> dict[str, list[Path]]:
    """Write data/<split>-<number>-of-<count>.parquet; return the files of each split that has rows."""
    files: dict[str, list[Path]] = {}
    for split in source.counts:
        part = f"{folder}/data/{split}-{{}}.parquet"
        numbers = write_files(source.blocks(source.of_split(split)), source.variables, part.format)
        count = numbers[-1] + 1
        files[split] = [
            Path(part.format(number)).rename(part.format(f"{number:05d}-of-{count:05d}"))
            for number in range(count)
        ]
    return files


EXPORT = Export(
    "huggingface",
    "`data/<split>-*.parquet` and a card with front matter: `datasets.load_dataset(FOLDER)` has train, validation and test",
    write,
)
