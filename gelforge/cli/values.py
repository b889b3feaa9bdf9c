"""Values of arguments that are more than a text or a number: studies, depths, the size of a board; standard library only."""

from __future__ import annotations

import math
import re
from argparse import ArgumentTypeError
from pathlib import Path

CONFIG = Path("config")
STUDY_KEY = re.compile(r"""^study:\s*["']?([A-Za-z0-9_-]+)["']?\s*(?:#.*)?$""", re.MULTILINE)


def study_names(*_, **__) -> dict[str, Path]:
    """Return the files of the folder config that describe a study, by the name that their key `study` gives.

    The demo's is config/config.yaml, where Snakemake's catalog looks for it. Also a completer of argcomplete.
    """
    files = (path for path in sorted(CONFIG.glob("*.yaml")) if path.is_file())
    texts = ((path, path.read_bytes().decode("utf-8", "replace")) for path in files)
    return {match[1]: path for path, text in texts if (match := STUDY_KEY.search(text))}


def study_file(text: str) -> Path:
    """Return the YAML file of a study given by its name or its file; a file is opened, and may be refused, later."""
    if text.endswith((".yaml", ".yml")) or "/" in text or Path(text).is_file():
        return Path(text)
    if (named := CONFIG / f"{text}.yaml").is_file():
        return named
    names = study_names()
    if text in names:
        return names[text]
    known = ", ".join(sorted(names)) or "none; run this in the folder that holds config"
    raise ArgumentTypeError(f"no study {text!r}; the studies in {CONFIG} are {known}; or name a YAML file")


def depth_list(text: str) -> list[float]:
    """Return increasing depths [mm] from `0.25:2:0.25` (first:last:step) or `0.5,1,2`."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            # (last - first) / step may be rounded by 1e-16
            count = math.floor((last - first) / step + 1e-9) + 1
            depths = [round(first + i * step, 9) for i in range(count)]
        else:
            depths = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError):
        raise ArgumentTypeError(f"{text!r}: write first:last:step or a comma-separated list") from None
    if not depths or depths[0] <= 0 or any(b <= a for a, b in zip(depths, depths[1:])):
        raise ArgumentTypeError(f"{text!r} gives {depths}; depths must be positive and increase")
    return depths


def board_size(text: str) -> tuple[int, int]:
    """Return columns and rows of a board from `9x6`."""
    try:
        columns, rows = (int(part) for part in text.lower().split("x"))
    except ValueError:
        raise ArgumentTypeError(f"{text!r}: write columns x rows, such as 9x6") from None
    return columns, rows
