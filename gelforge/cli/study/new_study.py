"""The commented files of a new study, for `gelforge init`; their texts are in new/."""

from __future__ import annotations

from pathlib import Path
from string import Template
from textwrap import indent

from gelforge.config import LAW_NAMES

BALL = "ball of radius 5 mm"


def new_study_files(study: str) -> dict[Path, str]:
    """Return the files of a new study with their text, by path."""
    data = Path("data") / study
    return {
        Path("config") / f"{study}.yaml": _text("config.yaml", study=study, laws=", ".join(LAW_NAMES)),
        data / "sensor.yaml": _text("sensor.yaml"),
        data / "plan.csv": _text("plan.csv"),
        data / "materials" / "gel" / "samples.csv": _text("samples.csv"),
        **session_files(study, BALL, _text("camera.yaml")),
    }


def session_files(study: str, indenter: str, camera: str) -> dict[Path, str]:
    """Return a new study's session and the mapping of its raw logs, by path; camera: its keys in session.yaml, as text."""
    camera, data = camera.removesuffix("\n"), Path("data") / study
    logs = _text("logs.yaml", study=study, indenter=indenter, camera=indent(camera, "  "))
    return {
        data / "recordings" / "session1" / "session.yaml": _text(
            "session.yaml", indenter=indenter, camera=camera
        ),
        data / "logs.yaml": logs,
    }


def mapping_files(study: str) -> dict[Path, str]:
    """Return the commented mapping of the files of a test machine, by path."""
    path = Path("data") / study / "materials" / "mapping.yaml"
    return {path: _text("mapping.yaml", study=study, path=path.as_posix())}


def _text(name: str, **values: str) -> str:
    """Return a text of new/ with values in place of its $names."""
    return Template((Path(__file__).parent / "new" / name).read_text(encoding="utf-8")).substitute(values)
