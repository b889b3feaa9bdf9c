"""How near a recorded position must lie to its site."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from gelforge.config import ConfigError, Study, load_session
from gelforge.indentation.paths.places import POSITION_MATCH_MM, within

# Of the stage's standard deviation along each axis. Of normal deviations exp(-5^2 / 2), one in 270 000, lie beyond the
# first, exp(-3^2 / 2), one in 90, beyond the second (Rayleigh 1880; tests/indentation/test_recorded_plan.py).
REPEATABILITIES, LEAST_REPEATABILITIES = 5.0, 3.0


def place_tolerance_mm(study: Study) -> float:
    """Return within which distance recorded positions are at a site of the study's plan.

    The key plan.tolerance_mm, or what the largest repeatability of its sessions' stages asks for.

    Parameters
    ----------
    study : Study
        Its plan and sessions.

    Returns
    -------
    float
        [mm].

    Raises
    ------
    ConfigError
        Where the key is below three times that repeatability.
    """
    repeatability, given = stage_repeatability_mm(study), study.plan.tolerance_mm
    if given is None:
        return tolerance_of_stage_mm(repeatability)
    least = LEAST_REPEATABILITIES * repeatability
    if not within(least, given):
        raise ConfigError(
            f"plan.tolerance_mm {given:g} mm is below three times the repeatability {repeatability:g} mm that a session"
            f" states: indentations at one site would count as several; make it {least:g} or more, or leave it out"
        )
    return given


def tolerance_of_stage_mm(repeatability_mm: float | None) -> float:
    """Return the tolerance of the positions of a stage.

    Parameters
    ----------
    repeatability_mm : float or None
        Standard deviation along each axis [mm]; None where it is not known.

    Returns
    -------
    float
        [mm], at least POSITION_MATCH_MM.
    """
    return max(POSITION_MATCH_MM, REPEATABILITIES * (repeatability_mm or 0.0))


def stage_repeatability_mm(study: Study) -> float:
    """Return the largest repeatability [mm] that a session states, 0 where none does or a virtual lab makes them."""
    if study.virtual_lab:
        return 0.0
    files = [study.session_folder(name) / "session.yaml" for name in study.sessions]
    stated = [_repeatability(path, path.stat().st_mtime_ns) for path in files if path.is_file()]
    return max(stated, default=0.0)


@lru_cache(maxsize=256)
def _repeatability(path: Path, changed_ns: int) -> float:
    return load_session(path).stage_to_sensor.repeatability_mm or 0.0
