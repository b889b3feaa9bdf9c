"""What a folder needs so that `snakemake` runs studies in it: a Snakefile, profiles, and the examples on request."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError
from gelforge.files import atomic
from gelforge.shipped import EXAMPLES, WORKFLOW

SNAKEFILE = """\
# The workflow of the gelforge that is installed next to Snakemake.
from gelforge.shipped import SNAKEFILE

{default}
include: str(SNAKEFILE)


workflow.default_target = "all"  # an included file's is not taken over
"""
DEFAULT = """\
if "study" not in config:  # no --configfile

    configfile: "config/{study}.yaml"

"""
PROFILES = ("default/config.yaml", "slurm/config.yaml")
EXAMPLE_FOLDERS = ("config", "data/benchmark", "data/demo", "data/gelsight_mini", "data/paper")
ABOUT_DATA = "data/README.md"
MADE = {"recordings", "virtual_truth", "__pycache__"}  # by runs, in the checkout's data


def make_runnable(study: str | None = None) -> list[Path]:
    """Write Snakefile, profiles and schema where this folder has no workflow; return the paths that were written.

    study: what `snakemake` runs without --configfile, where the folder has no config/config.yaml (the demo).
    """
    if Path("Snakefile").exists() or Path("workflow/Snakefile").exists():
        return []
    schema = Path("config/schema.json")
    default = DEFAULT.format(study=study) if study and not Path("config/config.yaml").exists() else ""
    snakefile = SNAKEFILE.format(default=default)
    files = {Path("Snakefile"): snakefile.encode(), schema: (EXAMPLES / schema).read_bytes()}
    files |= {Path("profiles", name): (WORKFLOW / "profiles" / name).read_bytes() for name in PROFILES}
    return [_written(path, content) for path, content in files.items() if not path.exists()]


def write_examples() -> list[Path]:
    """Write the example studies (config/) and what they read (data/) into this folder; return the paths.

    What is there already as it is shipped stays: snakedeploy brings config/ without data/. Raises ConfigError, and writes
    nothing, where one of the files differs.
    """
    shipped = [path for top in EXAMPLE_FOLDERS for path in sorted((EXAMPLES / top).rglob("*"))]
    shipped.append(EXAMPLES / ABOUT_DATA)
    files = {path.relative_to(EXAMPLES): path for path in shipped if path.is_file()}
    files = {to: path for to, path in files.items() if not MADE & set(to.parts)}
    new = {to: path for to, path in files.items() if not to.exists()}
    others = [str(to) for to in files if to not in new and to.read_bytes() != files[to].read_bytes()]
    if others:
        more = f" and {len(others) - 3} more" if len(others) > 3 else ""
        raise ConfigError(
            f"{', '.join(others[:3])}{more} differ(s) from the example of that name; call it in an empty folder"
        )
    return [_written(to, path.read_bytes()) for to, path in new.items()]


def write_shipped(paths: list[Path]) -> list[Path]:
    """Write shipped files into this folder, under the same paths; return those that were not there before."""
    return [_written(path, (EXAMPLES / path).read_bytes()) for path in paths if not path.exists()]


def _written(path: Path, content: bytes) -> Path:
    with atomic(path) as temporary:
        temporary.write_bytes(content)
    return path
