"""Digests of the surface files that shape sensor and indenter: another content is another site."""

from __future__ import annotations

from gelforge.config import ConfigError, Indenter, Sensor
from gelforge.files import file_sha256


def surface_digests(sensor: Sensor) -> dict[str, str]:
    """Return the SHA-256 of each surface file that decides the sensor's shape."""
    missing = [str(path) for path in sensor.shape.files.values() if not path.is_file()]
    if missing:
        raise ConfigError(f"sensor.shape.files: {missing} do not exist; name STL, PLY or OBJ files that do")
    return {name: file_sha256(path) for name, path in sensor.shape.files.items()}


def file_digests(section: Indenter) -> dict[str, str]:
    """Return the SHA-256 of each surface file that decides the indenter's shape."""
    return {
        str(part.file): file_sha256(part.file) for part in section.shapes if part.file and part.file.is_file()
    }
