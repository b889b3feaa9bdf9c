"""What every mapping that makes a session has to say of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def check_acts_on(session: Mapping[str, Any]) -> None:
    """Check that the keys of a session.yaml state on what the recorded force acts. Raises ValueError where they do not."""
    force = session.get("force")
    if not isinstance(force, dict) or "acts_on" not in force:
        raise ValueError(
            "session.force.acts_on is missing: the recorded force acts on the sensor, or on the indenter"
        )
