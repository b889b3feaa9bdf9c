"""YAML files in and out; the only module that reads YAML."""

from __future__ import annotations

import warnings
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin

import yaml
from pydantic import ValidationError

from gelforge.config.common import ConfigError, OldKey, Section
from gelforge.config.session import Session, old_scatter
from gelforge.config.study import Study
from gelforge.config.variants import merged
from gelforge.config.virtual_lab import VirtualLab


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigError(f"{path}: no such file; name a YAML file that exists") from None
    except yaml.YAMLError as error:
        raise ConfigError(f"{path}: not valid YAML ({error})") from None
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: not UTF-8 ({error}); save it as UTF-8") from None
    except ValueError as error:  # a date without quotes that no calendar has
        raise ConfigError(f"{path}: not valid YAML ({error}); put dates in quotes") from None
    if not isinstance(content, dict):
        raise ConfigError(f"{path}: a mapping of keys is expected, found {type(content).__name__}")
    return content


def _validated(model: type[Section], content: dict[str, Any], source: str):
    try:
        return model.model_validate(content)
    except ValidationError as error:
        lines = []
        for item in error.errors():
            key = ".".join(str(part) for part in item["loc"]) or "(whole file)"
            found = "" if isinstance(item["input"], dict) else f", found {item['input']!r}"
            unknown = item["type"] == "extra_forbidden"
            remedy = (
                _unknown_key(model, item["loc"]) if unknown else item["msg"].removeprefix("Value error, ")
            )
            lines.append(f"{source}: {key}{found}: {remedy}")
        raise ConfigError("\n".join(lines)) from None


def _unknown_key(model: type[Section], location: tuple[str | int, ...]) -> str:
    """Return what to do about a key that its section does not have: the nearest key, or all that there are."""
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
            return list(fields)
        return _keys_of(fields[location[0]].annotation, location[1:]) if location[0] in fields else []
    inner = get_args(kind)
    return _keys_of(inner[-1], location[1:]) if inner and location else []


def study_from(content: dict[str, Any], source: str = "config") -> Study:
    """Return the validated study of a configuration mapping; `sensor` and `indenter` may name YAML files."""
    content = dict(content)
    for key in ("sensor", "indenter"):
        if isinstance(content.get(key), str):
            content[key] = _read_yaml(Path(content[key]))
    study = _validated(Study, content, source)
    for name in study.variants:
        variant_study(study, name, source)
    return study


def variant_study(study: Study, name: str, source: str = "config") -> Study:
    """Return the study as a variant changes it, without variants of its own."""
    if name not in study.variants:
        raise ConfigError(f"{source}: no variant {name!r}; the study has {sorted(study.variants)}")
    changes = study.variants[name].model_dump(include={"sensor", "indenter", "mechanics"})
    content = merged(study.model_dump(mode="json", exclude={"variants"}), changes)
    return _validated(Study, content, f"{source}: variants.{name}")


def load_study(path: str | Path) -> Study:
    """Return the validated study described by a YAML file."""
    return study_from(_read_yaml(Path(path)), str(path))


def load_session(path: str | Path) -> Session:
    """Return the validated session described by a session.yaml; an old key is read with a warning (OldKey)."""
    content = _read_yaml(Path(path))
    session = _validated(Session, content, str(path))
    old = old_scatter(content)
    if old:
        warnings.warn(f"{path}: {old}", OldKey, stacklevel=1)  # one place: told once, whoever loads it
    return session


def load_virtual_lab(path: str | Path) -> VirtualLab:
    """Return the validated virtual lab described by a YAML file."""
    return _validated(VirtualLab, _read_yaml(Path(path)), str(path))


def section_from(model: type[Section], content: dict[str, Any], source: str) -> Any:
    """Return the validated section of a mapping of keys, e.g. of a command's arguments."""
    return _validated(model, content, source)


def load_section(path: str | Path, model: type[Section]) -> Any:
    """Return the validated section of another kind (a mapping of columns, a small test) that a YAML file holds."""
    return _validated(model, _read_yaml(Path(path)), str(path))


def write_yaml(path: str | Path, content: Section | dict[str, Any]) -> None:
    """Write a section, or some of its keys, as YAML in the order of the model."""
    keys = content.model_dump(mode="json") if isinstance(content, Section) else content
    Path(path).write_text(yaml.safe_dump(keys, sort_keys=False), encoding="utf-8")


def schema() -> dict[str, Any]:
    """Return the JSON schema of a study's configuration; config/schema.json holds it."""
    return Study.model_json_schema()
