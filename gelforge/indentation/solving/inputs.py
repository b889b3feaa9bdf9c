"""What decides a site's numbers, as one digest."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path

from gelforge.config import Indenter, Mechanics, Sensor, Study
from gelforge.files import digest, file_sha256, source_digest
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.sensor.surface_files import file_digests, surface_digests
from gelforge.mechanics.laws.law import PrincipalLaw


def inputs_digest(study: Study, laws: Mapping[str, PrincipalLaw], planned: PlannedCell) -> str:
    """Return the digest of everything that decides a site's numbers: settings, laws, position, depths, sources.

    Parameters
    ----------
    study : Study
        Its sensor, indenter and mechanics count.
    laws : mapping of PrincipalLaw
        By material.
    planned : PlannedCell
        The site and its path.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    return digest(
        {
            **model_inputs(study, laws),
            "cell": [planned.x_mm, planned.y_mm, planned.depths_mm, planned.source, planned.symmetry],
            **({"between": planned.between} if planned.between else {}),
            "path": [planned.phases, planned.shears_mm, planned.tilts_deg, planned.twists_deg],
            "sources": _sources(),
        }
    )


@cache
def _sources() -> str:
    """Return the digest of the sources that solve a site, read once: a process goes on with those that it began with."""
    return source_digest("mechanics", "meshing", "indentation")


def model_inputs(study: Study, laws: Mapping[str, PrincipalLaw]) -> dict:
    """Return what decides a site's numbers, but its path and the sources: settings of the solver, and laws."""
    materials = {layer.material for layer in study.sensor.layers}
    of_laws = {
        "laws": {name: laws[name].description() for name in materials},
        "approach": study.plan.approach,
    }
    return described(study.sensor, study.indenter, study.mechanics) | of_laws


def described(sensor: Sensor, indenter: Indenter, mechanics: Mechanics) -> dict[str, dict]:
    """Return sections of a study with the digests of the files that they name."""
    return {
        "sensor": sensor.model_dump(mode="json"),
        "sensor_files": surface_digests(sensor),
        "indenter": indenter.model_dump(mode="json"),
        "indenter_files": file_digests(indenter),
        "mechanics": mechanics.model_dump(mode="json"),
    }


def solution_digest(
    study: Study, laws: Mapping[str, PrincipalLaw], planned: PlannedCell, law_files: Iterable[Path]
) -> str:
    """Return the digest of everything that decides a solved site's file, its error bars and warnings too.

    These follow the covariances and tested ranges in the files of the laws.

    Parameters
    ----------
    study : Study
        Sensor, indenter and mechanics.
    laws : mapping of str to PrincipalLaw
        By material.
    planned : PlannedCell
        The site.
    law_files : iterable of Path
        Files of the laws, in any order.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    files = sorted(file_sha256(path) for path in law_files)
    sources = source_digest("materials/fitting/law_file.py")
    return digest([inputs_digest(study, laws, planned), files, sources])
