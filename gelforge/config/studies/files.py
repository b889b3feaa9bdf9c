"""YAML files in and out; the only module that reads YAML."""

from __future__ import annotations

from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import yaml
from pydantic import ValidationError

from gelforge.config.basis.variants import merged
from gelforge.config.basis.yaml_text import NoYaml, parsed, short
from gelforge.config.parts.camera import Camera
from gelforge.config.sessions.session import Session
from gelforge.config.sessions.virtual_lab import VirtualLab
from gelforge.config.studies.study import Study
from gelforge.input_files import NotAFile, another_kind, read_bytes
from gelforge.section import ConfigError, Section

FORMER_KEYS = {  # of earlier files, and what to write in their place
    "touchdown_mm": "contact_point_scatter_mm",
    "scatter_mm": "session_scatter_mm or, where every indentation finds its contact point, press_scatter_mm",
    "gap_tolerance_mm": "gap_tolerance, over the element size",
}
# Cubes of what is below stay numbers in float32 too: 1e36 of 3.4e38 (IEEE 754-2019).
LARGEST = 1e12


def read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = parsed(read_bytes(path).decode("utf-8-sig"))
    except NotAFile as error:
        remedy = "; name a YAML file that exists" if "no such file" in str(error) else ""
        raise ConfigError(str(error).replace("; name one that exists", "") + remedy) from None
    except (UnicodeDecodeError, NoYaml) as error:
        words = another_kind(path, "a YAML file")
        if not words and isinstance(error, UnicodeDecodeError):
            words = f": byte {error.start} is not UTF-8; save the file as UTF-8 text"
        raise ConfigError(f"{path}{words or error}") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: a mapping of keys is expected, found {type(content).__name__}")
    return content


def _validated(model: type[Section], content: dict[str, Any], source: str, new: dict[str, Any] | None = None):
    """Return the section of a content; new: the part of it that was not read before, None: all. Raises ConfigError."""
    try:
        section = model.model_validate(content)
    except ValidationError as error:
        lines = []
        for item in error.errors():
            key = ".".join(str(part) for part in item["loc"]) or "(whole file)"
            said = "" if isinstance(item["input"], dict) else f", found {short(repr(item['input']))}"
            unknown = item["type"] == "extra_forbidden"
            remedy = (
                _unknown_key(model, item["loc"]) if unknown else item["msg"].removeprefix("Value error, ")
            )
            lines.append(f"{source}: {short(key)}{said}: {short(remedy, 600)}")
        more = len(lines) - 5
        if more > 0:  # a file of another kind has nothing but errors
            lines = [*lines[:5], f"{source}: and {more} errors more; is it a file of this kind?"]
        raise ConfigError("\n".join(lines)) from None
    except RecursionError:
        raise ConfigError(f"{source}: nested too deeply; remove sections inside sections") from None
    new = content if new is None else new
    if key := _first(new, section, _truth_as_number):
        raise ConfigError(f"{source}: {key}: true or false where a number belongs; write the number")
    if key := _first(new, section, _beyond_measure):
        raise ConfigError(
            f"{source}: {key}: nothing is larger than {LARGEST:g}, or smaller than {1 / LARGEST:g} and not 0; correct it"
        )
    return section


def _first(content: Any, read: Any, wrong: Callable[[Any, Any], bool]) -> str:
    """Return the key of the first value of a content that is wrong, given how it was read; empty: there is none."""
    if isinstance(content, dict):
        pairs = ((key, part, _part(read, key)) for key, part in content.items())
    elif isinstance(content, (list, tuple)) and isinstance(read, (list, tuple)):
        pairs = ((number, *both) for number, both in enumerate(zip(content, read)))
    else:
        return "." if wrong(content, read) else ""
    for key, part, path in pairs:
        if part_with := _first(part, path, wrong):
            return f"{key}.{part_with}".rstrip(".")
    return ""


def _truth_as_number(content: Any, read: Any) -> bool:
    """Return whether a truth value was read as a number, as Python's True is 1."""
    return isinstance(content, bool) and isinstance(read, (int, float)) and not isinstance(read, bool)


def _beyond_measure(content: Any, read: Any) -> bool:
    """Return whether a number is of no size that anything has; whole ones, such as seeds, may fill 63 bits."""
    if isinstance(read, bool) or not isinstance(read, (int, float)):
        return False
    size = abs(read)
    return size >= 2**63 if isinstance(read, int) else size > LARGEST or 0 < size < 1 / LARGEST


def _part(read: Any, key: Any) -> Any:
    return read.get(key) if isinstance(read, dict) else getattr(read, str(key), None)


def _unknown_key(model: type[Section], location: tuple[str | int, ...]) -> str:
    """Return what to do about a key that its section does not have: the nearest key, or all that there are."""
    if name := FORMER_KEYS.get(str(location[-1])):
        return f"former key; write {name}"
    keys = _keys_of(model, location[:-1])
    near = get_close_matches(str(location[-1]), keys, n=1)
    if near:
        return f"unknown key; did you mean {near[0]}?"
    return f"unknown key; the keys here are {', '.join(keys)}" if keys else "unknown key; remove it"


def _keys_of(kind: Any, location: tuple[str | int, ...]) -> list[str]:
    """Return the keys of the section at a location below a type; none where several sections are possible."""
    if get_origin(kind) in (Union, UnionType):
        sections = [part for part in get_args(kind) if part is not NoneType]
        return _keys_of(sections[0], location) if len(sections) == 1 else []
    if isinstance(kind, type) and issubclass(kind, Section):
        fields = kind.model_fields
        if not location:
            return [field.alias or name for name, field in fields.items()]
        return _keys_of(fields[location[0]].annotation, location[1:]) if location[0] in fields else []
    inner = get_args(kind)
    return _keys_of(inner[-1], location[1:]) if inner and location else []


def study_from(content: dict[str, Any], source: str = "config") -> Study:
    """Return the study that a mapping of keys describes.

    Parameters
    ----------
    content : dict
        Keys of a study; `sensor` and `indenter` may name YAML files.
    source : str
        What messages call it.

    Returns
    -------
    Study
        Validated, its variants too.

    Raises
    ------
    ConfigError
        As `load_study`.
    """
    content = dict(content)
    for key in ("sensor", "indenter"):
        if isinstance(content.get(key), str):
            content[key] = read_yaml(Path(content[key]))
    study = _validated(Study, content, source)
    for name in study.variants:
        variant_study(study, name, source)
    return study


def changed_study(study: Study, changes: dict[str, Any], source: str = "config") -> Study:
    """Return the study with other keys, checked anew.

    Parameters
    ----------
    study : Study
        Stays as it is.
    changes : dict
        Keys to change; nested mappings are merged, all else is replaced.
    source : str
        What messages call the changes.

    Returns
    -------
    Study
        The changed study, its variants checked with it.

    Raises
    ------
    ConfigError
        Where the changed keys are out of range or contradict others.

    Examples
    --------
    >>> changed_study(study, {"mechanics": {"friction": 0.5}}).mechanics.friction
    0.5
    """
    content = merged(study.model_dump(mode="json"), changes)
    changed = _validated(Study, content, source, changes)
    for name in changed.variants:
        variant_study(changed, name, source)
    return changed


def variant_study(study: Study, name: str, source: str = "config") -> Study:
    """Return the study as one of its variants changes it.

    Parameters
    ----------
    study : Study
        Stays as it is.
    name : str
        A key of `study.variants`.
    source : str
        What messages call the study.

    Returns
    -------
    Study
        Without variants.

    Raises
    ------
    ConfigError
        For a name that is no variant of the study.
    """
    if name not in study.variants:
        raise ConfigError(f"{source}: no variant {name!r}; the study has {sorted(study.variants)}")
    changes = study.variants[name].model_dump(include={"sensor", "indenter", "mechanics"})
    content = merged(study.model_dump(mode="json", exclude={"variants"}), changes)
    return _validated(Study, content, f"{source}: variants.{name}")


def load_study(path: str | Path) -> Study:
    """Return the study that a YAML file describes.

    Parameters
    ----------
    path : str or Path
        The file; files that it names (sensor, indenter) are read relative to the working folder.

    Returns
    -------
    Study
        Validated and complete: keys that the file leaves out have their defaults.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key, a value out of range or keys that contradict each other. The
        message names file, key, value and remedy.

    Examples
    --------
    >>> load_study("config/paper.yaml").sensor.height_mm
    6.0
    """
    return study_from(read_yaml(Path(path)), str(path))


def load_session(path: str | Path) -> Session:
    """Return the session that a session.yaml describes.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Session
        Validated: force sensor, stage, camera and depth zero of one recording.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key or a value out of range.
    """
    return _validated(Session, read_yaml(Path(path)), str(path))


def load_camera(path: str | Path, **completed: Any) -> Camera:
    """Return the camera of a YAML file.

    Parameters
    ----------
    path : str or Path
        Its keys are those of `camera` in session.yaml, or stand under `camera`.
    **completed
        Keys that the file may lack, such as a pose. What the file says holds.

    Returns
    -------
    Camera
        Validated.

    Raises
    ------
    ConfigError
        For a file without a position, and for a session without camera.
    """
    content = read_yaml(Path(path))
    nested = isinstance(content.get("camera"), dict)
    if not nested and ("camera" in content or "session" in content):
        raise ConfigError(f"{path}: the session describes no camera; give the YAML of a calibration")
    keys = content["camera"] if nested else content
    source = f"{path}: camera" if nested else str(path)
    if "position_mm" not in keys and "position_mm" not in completed:
        raise ConfigError(
            f"{source}: no position_mm: a calibration finds no pose; add position_mm, rotation_deg and mirrored by hand, or "
            "by `gelforge camera-pose`"
        )
    return _validated(Camera, completed | keys, source)


def load_virtual_lab(path: str | Path) -> VirtualLab:
    """Return the virtual lab that a YAML file describes.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    VirtualLab
        Validated: the true physics, particles, imaging and sessions of SYNTHETIC recordings.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key or a value out of range.
    """
    return _validated(VirtualLab, read_yaml(Path(path)), str(path))


def section_from(model: type[Section], content: dict[str, Any], source: str) -> Any:
    """Return the section of the configuration that a mapping of keys describes.

    Parameters
    ----------
    model : type of Section
        The class of the section.
    content : dict
        Its keys, e.g. those of a command's arguments.
    source : str
        What messages call it.

    Returns
    -------
    Section
        Validated, of class `model`.

    Raises
    ------
    ConfigError
        For an unknown key or a value out of range.
    """
    return _validated(model, content, source)


def load_section(path: str | Path, model: type[Section]) -> Any:
    """Return the section of the configuration that a YAML file holds.

    Parameters
    ----------
    path : str or Path
        The file.
    model : type of Section
        The class of the section.

    Returns
    -------
    Section
        Validated, of class `model`.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key or a value out of range.
    """
    return _validated(model, read_yaml(Path(path)), str(path))


def write_yaml(path: str | Path, content: Section | dict[str, Any]) -> None:
    """Write a section, or some of its keys, as YAML in the order of the model.

    Parameters
    ----------
    path : str or Path
        The file; it is replaced.
    content : Section or dict
        What `load_study` and its like read back.
    """
    keys = content.model_dump(mode="json") if isinstance(content, Section) else content
    Path(path).write_text(yaml.safe_dump(keys, sort_keys=False), encoding="utf-8")


def schema() -> dict[str, Any]:
    """Return the JSON schema of a study's configuration; config/schema.json holds it."""
    return Study.model_json_schema()
