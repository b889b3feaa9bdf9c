"""A stage that scatters: a verdict sees one site where the stage came back, and no last move where it only scattered."""

import numpy as np
from session_folder import HEADER, press_lines, write_session

from gelforge.config import Sensor
from gelforge.mismatch.readings.sessions import observe

SENSOR = Sensor.model_validate({"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "m"}]})


def test_positions_within_the_stages_repeatability_are_one_site(tmp_path):
    rng = np.random.default_rng(0)
    places = np.repeat([(10.0, 12.0), (16.0, 16.0)], 5, axis=0) + rng.normal(0, 0.015, (10, 2))
    presses = [press_lines(f"p{k}", k, *xy.round(6), 0.8, False) for k, xy in enumerate(places)]
    lines = [HEADER, *(line for press in presses for line in press)]
    stated = write_session(
        tmp_path / "stated", lines=lines, extra="stage_to_sensor: {repeatability_mm: 0.015}\n"
    )
    found = observe([stated], SENSOR)
    assert len(found.sites) == 2
    moved = np.abs(found.came_along).sum(axis=(1, 2)) > 0
    assert (moved == (found.table["x_mm"] > 13)).all()  # after the only move
    unknown = observe([write_session(tmp_path / "unknown", lines=lines)], SENSOR)
    assert len(unknown.sites) > 5
    assert (np.abs(unknown.came_along).sum(axis=(1, 2)) > 0).sum() > moved.sum()
