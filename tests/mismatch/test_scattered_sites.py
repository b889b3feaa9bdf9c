"""A stage that scatters: a verdict sees one site where the stage came back, and no last move where it only scattered."""

import numpy as np
from session_folder import HEADER, press_lines, write_session

from gelforge.config import Sensor
from gelforge.mismatch.readings.sessions import observe

SENSOR = Sensor.model_validate({"layers": [{"name": "gel", "thickness_mm": 6.0, "material": "m"}]})


def test_positions_within_the_stages_repeatability_are_one_site(tmp_path):
    rng = np.random.default_rng(0)
    places = np.repeat([(10.0, 12.0), (16.0, 16.0)], 5, axis=0) + rng.normal(0, 0.015, (10, 2))
    lines = [
        line for k, xy in enumerate(places) for line in press_lines(f"p{k}", k, *xy.round(6), 0.8, False)
    ]
    for name, stage, sites in (
        ("stated", "repeatability_mm: 0.015", 2),
        ("unknown", "rotation_deg: 0.0", 10),
    ):
        folder = write_session(
            tmp_path / name, lines=[HEADER, *lines], extra=f"stage_to_sensor: {{{stage}}}\n"
        )
        found = observe([folder], SENSOR)
        assert len(found.sites) == sites
        moved = np.abs(found.came_along).sum(axis=(1, 2)) > 0
        assert moved.sum() == 4 * (5 if sites == 2 else 9)  # readings of indentations after a first move
