"""`gelforge init` and `gelforge examples`: the files with which a study begins."""

from __future__ import annotations

import re
from pathlib import Path

from gelforge.cli.study.new_study import mapping_files, new_study_files
from gelforge.cli.study.shipped_sensors import sensor_files, study_of_sensor
from gelforge.cli.study.working_folder import make_runnable, write_examples, write_shipped
from gelforge.config import NAME, ConfigError
from gelforge.files import write_text
from gelforge.shipped import EXAMPLES

# of a Snakefile that uses the workflow as one, as snakedeploy writes it
MODULE = re.compile(r"^module \w+:", re.MULTILINE)


def init(study: str, sensor: str | None) -> None:
    """Write the commented files of a new study, of a shipped sensor if one is named; an existing file is never replaced."""
    if not NAME.fullmatch(study):
        raise ConfigError(f"{study!r} is not a name; use letters, digits, '_' and '-'")
    files = study_of_sensor(study, sensor) if sensor else new_study_files(study)
    files |= mapping_files(study)
    existing = [str(path) for path in files if path.exists()]
    if existing:
        raise ConfigError(f"{', '.join(existing)} exist(s) already; choose another name or delete them")
    for path, text in files.items():
        write_text(path, text)
        print(path)
    mappings = sorted((EXAMPLES / "config/mappings").glob("*.yaml"))
    shipped = [*(sensor_files(sensor) if sensor else []), *(path.relative_to(EXAMPLES) for path in mappings)]
    for path in [*write_shipped(shipped), *make_runnable(study)]:
        print(path)
    if sensor:
        print(f"labels only, ready: gelforge check {study}, then: snakemake --cores 2{choice_of(study)}")
    else:
        print(f"edit them, add your data, then: gelforge check {study}")


def choice_of(study: str) -> str:
    """Return what a Snakemake line in this folder needs in order to run a study."""
    named, snakefiles = f"config/{study}.yaml", (Path("Snakefile"), Path("workflow/Snakefile"))
    rules = next((path.read_text() for path in snakefiles if path.is_file()), "")
    if named in rules:
        return ""
    as_module = MODULE.search(rules) is not None  # whose own configuration --configfile only extends
    return f" --configfile {named}" + (" --replace-workflow-config" if as_module else "")


def examples() -> None:
    """Write the example studies and their data into this folder; an existing file is never replaced."""
    for path in [*write_examples(), *make_runnable()]:
        print(path)
    print("the demo: snakemake --cores 2; another: snakemake --cores 2 --configfile config/test.yaml")
