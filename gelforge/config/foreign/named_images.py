"""A folder of images whose names hold position, depth and force, as a mapping of `gelforge import` declares it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pydantic import Field, model_validator

from gelforge.config.foreign.session_keys import check_acts_on
from gelforge.config.studies.files import load_section, read_yaml
from gelforge.section import ConfigError, Section
from gelforge.units import UNITS, unit_named

NUMBER = r"([-+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?)"
PLACE = re.compile(r"{(\w*)}")
QUANTITIES = {"x": "length", "y": "length", "depth": "length", "fx": "force", "fy": "force", "fz": "force",
              "time": "time"}  # fmt: skip
NEEDED = ("x", "y", "depth", "fz")


class NamedImages(Section):
    """A folder of images whose names hold numbers."""

    folder: str = Field(".", description="folder of the images, from the mapping's folder")
    names: str = Field(
        description="a name with {QUANTITY_UNIT} for each number, as x{x_mm}_y{y_mm}_z{depth_mm}_f{fz_N}.png; {press} for an"
        " indentation's name, {} for anything"
    )
    reference: str | None = Field(
        None, description="the image without contact, in that folder; null: the first one of depth 0"
    )

    @model_validator(mode="after")
    def _names_are_read(self):
        found = self.quantities
        if missing := [name for name in NEEDED if name not in found]:
            raise ValueError(
                f"names holds no {', '.join(missing)}; a session needs x, y, depth and fz of each image: describe logs that"
                " have them, or take the images alone with `gelforge import-set table`"
            )
        if twice := {name for name in found if found.count(name) > 1}:
            raise ValueError(
                f"names holds {', '.join(sorted(twice))} twice; keep one, put {{}} for the other"
            )
        return self

    @property
    def quantities(self) -> list[str]:
        """Return what the groups of the expression hold, in their order: x, y, depth, fx, fy, fz, time, press."""
        return [name for name, _ in self._places]

    @property
    def factors(self) -> dict[str, float]:
        """Return the factor that brings each number to mm, N or s."""
        return {name: UNITS[unit][1] for name, unit in self._places if unit}

    @property
    def expression(self) -> re.Pattern[str]:
        """Return the regular expression of a whole name."""
        parts = PLACE.split(self.names)
        text = re.escape(parts[0])
        for place, after in zip(parts[1::2], parts[2::2]):
            text += ".*?" if not place else "(.+?)" if place == "press" else NUMBER
            text += re.escape(after)
        return re.compile(text, re.IGNORECASE)

    @property
    def _places(self) -> list[tuple[str, str | None]]:
        places: list[tuple[str, str | None]] = []
        for place in PLACE.findall(self.names):
            name, _, said = place.partition("_")
            unit = unit_named(said)
            if place in ("", "press"):
                places += [("press", None)] if place else []
            elif unit is None or UNITS[unit][0] != QUANTITIES.get(name):
                raise ValueError(
                    f"names: {{{place}}} is no quantity with its unit; one of {', '.join(QUANTITIES)}, as {{x_mm}}, {{fz_N}}"
                )
            else:
                places.append((name, unit))
        return places


class NamesMapping(Section):
    """A session whose numbers are in the names of its images."""

    describes: str = Field(description="whose images these are, in words")
    images: NamedImages = Field(description="the images, and what their names hold")
    session: dict[str, Any] = Field(
        description="keys of session.yaml: sensor, indenter, stage_to_sensor, camera, ...; force.acts_on is required"
    )

    @model_validator(mode="after")
    def _session_keys(self):
        check_acts_on(self.session)
        return self


def load_names(path: str | Path) -> NamesMapping | None:
    """Return the mapping that says what the names of images mean.

    Parameters
    ----------
    path : str or Path
        YAML.

    Returns
    -------
    NamedImages
        Validated.

    Raises
    ------
    ConfigError
        For a file that cannot be read, an unknown key or a pattern that names no quantity.
    """
    content = read_yaml(Path(path))
    if not isinstance(content, dict) or "images" not in content:
        return None
    if logs := sorted({"force", "stage", "camera"} & set(content)):
        raise ConfigError(f"{path}: images are described, and {', '.join(logs)}: describe one of the two")
    return load_section(path, NamesMapping)
