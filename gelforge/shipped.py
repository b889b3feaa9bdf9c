"""Where the files are that are not Python: the workflow's rules and profiles, and the example studies with their data.

A wheel has them inside the package (setup.py copies them there); a checkout has them next to it.
"""

from pathlib import Path

PACKAGE = Path(__file__).parent


def folder_of(shipped: Path, marker: str, otherwise: Path) -> Path:
    """Return the folder inside the package where it holds a file of this name, else the one in the checkout."""
    return shipped if (shipped / marker).is_file() else otherwise


WORKFLOW = folder_of(PACKAGE / "workflow", "Snakefile", PACKAGE.parent / "workflow")
SNAKEFILE = WORKFLOW / "Snakefile"
EXAMPLES = folder_of(PACKAGE / "examples", "config/paper.yaml", PACKAGE.parent)  # holds config/ and data/
