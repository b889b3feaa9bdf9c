"""The example of a robot in docs/importing.md agrees with the geometry that it describes."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from gelforge.config import ForceSensor, StageToSensor
from gelforge.indentation.sensor.stage_frame import stage_to_sensor
from gelforge.recording.readings import force_on_sensor

DOCS = Path(__file__).parents[2] / "docs/importing.md"
CORNER = 1e3 * np.array([0.412, -0.155])  # mm, of the sensor, in the base frame
AXES = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])  # the sensor's x, y and z in the base frame, as rows
TOOL = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]])  # the tool's x, y and z in the base frame, as rows


@pytest.fixture(scope="module")
def example():
    """Return the two descriptions of the force and the one of the stage, as the page writes them."""
    lines = re.findall(
        r"^    ((?:force: \{acts_on|stage_to_sensor: \{origin).*)$", DOCS.read_text(), re.MULTILINE
    )
    found = [yaml.safe_load(line) for line in lines]
    in_base, in_tool = (ForceSensor.model_validate(one["force"]) for one in found if "force" in one)
    (stage,) = (
        StageToSensor.model_validate(one["stage_to_sensor"]) for one in found if "stage_to_sensor" in one
    )
    return in_base, in_tool, stage


@pytest.mark.parametrize("place", [(0.0, 0.0), (10.0, 4.0), (3.0, 25.0)])
def test_the_robots_positions_come_to_the_sensor(example, place):
    base = CORNER + place[0] * AXES[0, :2] + place[1] * AXES[1, :2]
    assert np.allclose(stage_to_sensor(base[None], example[2]), [place], atol=1e-9)


@pytest.mark.parametrize("force", [(0.0, 0.0, -2.0), (-0.1, 0.0, -2.0), (0.3, -0.2, -1.0)])
def test_the_robots_forces_come_to_the_sensor(example, force):
    """force: on the sensor, in its frame; what the robot reads is the reaction, along the base's or the tool's axes."""
    reaction = -np.array(force) @ AXES
    assert np.allclose(force_on_sensor(reaction[None], example[0]), [force])
    assert np.allclose(force_on_sensor((TOOL @ reaction)[None], example[1]), [force])
