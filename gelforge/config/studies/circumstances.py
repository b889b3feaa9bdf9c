"""The study as it was in one session: at the age and temperature that its session.yaml states."""

from __future__ import annotations

from gelforge.config.sessions.session import Session
from gelforge.config.studies.files import changed_study
from gelforge.config.studies.study import Study


def session_study(study: Study, session: Session) -> Study:
    """Return the study at the age and temperature that a session states.

    Parameters
    ----------
    study : Study
        Stays as it is.
    session : Session
        `sensor_age_days` [d] and `temperature_C` [C] count where the study has a rate for them.

    Returns
    -------
    Study
        The study itself where nothing changes.

    Raises
    ------
    ConfigError
        Where the changed study is not valid.
    """
    known = study.mechanics.effects.material.circumstances
    stated = {}
    if any(known.ageing_per_day.values()) and session.sensor_age_days is not None:
        stated["age_days"] = session.sensor_age_days
    if any(known.stiffening_per_K.values()) and session.temperature_C is not None:
        stated["temperature_C"] = session.temperature_C
    if all(getattr(known, name) == value for name, value in stated.items()):
        return study
    changes = {"mechanics": {"effects": {"material": {"circumstances": stated}}}}
    return changed_study(study, changes, f"session {session.session}")
