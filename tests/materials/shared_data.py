"""Where the shared measurements lie, which are not part of the project; without them their tests are skipped."""

import os
from pathlib import Path

import pytest

from gelforge.config.foreign.mapping import load_mapping

ROOT = Path(__file__).parents[2]
SHARED = Path(os.environ.get("GELFORGE_SHARED", ROOT.parent / "shared")) / "data"
MAPPINGS = sorted((ROOT / "config" / "mappings").glob("*.yaml"))
needs_shared = pytest.mark.skipif(
    not SHARED.is_dir(), reason=f"the shared measurements are not in {SHARED}; set GELFORGE_SHARED"
)


def files_of(mapping: Path) -> list[str]:
    """Return the names of all tests in a mapping's folder, relative to it."""
    folder, described = SHARED / mapping.stem, load_mapping(mapping)
    names = sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())
    return [name for name in names if described.entry_for(name) is not None]
