"""Studies and what they are made of: those in files, the sensors that are shipped, the shapes that press."""

from __future__ import annotations

from contextlib import chdir
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

from gelforge import config
from gelforge.api import arguments
from gelforge.config import ConfigError, Indenter, Study
from gelforge.shipped import EXAMPLES

SMOKE = Path("config/smoke")


def sensors() -> list[str]:
    """Return the names of the shipped sensors (docs/sensors.md); `sensor(name)` is the study of one.

    Returns
    -------
    list of str
        In alphabetical order.

    Examples
    --------
    >>> import gelforge as gf
    >>> gf.sensors()
    ['9dtact', 'digit', 'dome', 'gelsight_mini', 'paper', 'tactip']
    """
    return sorted(path.stem for path in (EXAMPLES / SMOKE).glob("*.yaml"))


def sensor(name: str) -> Study:
    """Return the smoke study of a shipped sensor: its geometry, materials, indenter, mesh and a small plan.

    Parameters
    ----------
    name : str
        One of `gelforge.sensors()`.

    Returns
    -------
    Study
        Its parts are attributes, with the keys of the configuration: `sensor`, `indenter`, `materials`, `mechanics`, `plan`.
        Lengths are mm, moduli as their keys say.

    Raises
    ------
    ConfigError
        An unknown name, with the nearest that there is.

    Examples
    --------
    >>> import gelforge as gf
    >>> mini = gf.sensor("gelsight_mini")
    >>> mini.sensor.width_x_mm, mini.sensor.width_y_mm
    (20.75, 25.25)
    """
    names = sensors()
    if name not in names:
        near = shipped_like(name)
        hint = f"did you mean {near}? " if near else ""
        raise ConfigError(f"{name!r} is no sensor that is shipped; {hint}there are {', '.join(names)}")
    with chdir(EXAMPLES):
        return config.load_study(SMOKE / f"{name}.yaml")


def shipped_like(name: Any) -> str:
    """Return the shipped sensor with the nearest name; "" where none is near."""
    near = get_close_matches(str(name).lower().replace("-", "_"), sensors(), n=1, cutoff=0.4)
    return near[0] if near else ""


def load_study(path: str | Path) -> Study:
    """Return the validated study that a YAML file describes.

    Parameters
    ----------
    path : path
        The study's YAML file. Files that it names are looked for from the working folder.

    Returns
    -------
    Study
        As `gelforge.sensor` returns it.

    Raises
    ------
    ConfigError
        A file that is missing or no study; every wrong key with its value, the limit and the remedy.

    Examples
    --------
    >>> import gelforge as gf
    >>> from gelforge.shipped import EXAMPLES
    >>> study = gf.load_study(EXAMPLES / "config/paper.yaml")
    >>> study.study, study.sensor.height_mm
    ('paper', 6.0)
    """
    file = arguments.path("path", path, "a study's YAML file")
    if not file.exists() and not file.suffix and (near := shipped_like(path)):
        raise ConfigError(
            f"{path}: no such file; for the shipped sensor {near} take gelforge.sensor({near!r})"
        )
    return config.load_study(file)


def study_of(study: Any) -> Study:
    """Return a study that is given as it is, or as the path of its YAML file."""
    if isinstance(study, Study):
        return study
    if not isinstance(study, str | Path):
        raise ConfigError(
            f"study={arguments.shown(study)}: pass a study (gelforge.sensor('digit'), gelforge.load_study(path)) or the path"
            " of its YAML file"
        )
    return load_study(study)


def paper_study() -> Study:
    """Return the article's sensor with its published laws, as config/paper.yaml among the examples describes it."""
    with chdir(EXAMPLES):
        return config.load_study("config/paper.yaml")


def indenters() -> list[str]:
    """Return the kinds of indenters; the keys of each are in config/schema.json.

    Returns
    -------
    list of str
        Values of the key `kind` of an indenter.

    Examples
    --------
    >>> import gelforge as gf
    >>> gf.indenters()
    ['sphere', 'cylinder', 'box', 'mesh', 'several']
    """
    return list(get_args(Indenter.model_fields["kind"].annotation))
