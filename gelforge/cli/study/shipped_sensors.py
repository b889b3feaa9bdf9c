"""The sensors that are shipped (config/smoke, config/sensors, config/cameras): list, pictures, new studies of them."""

from __future__ import annotations

import re
from contextlib import chdir, nullcontext
from pathlib import Path

from gelforge.api.studies import SMOKE
from gelforge.api.studies import sensor as shipped_study
from gelforge.api.studies import sensors as sensor_names
from gelforge.cli.study.new_study import session_files
from gelforge.config import Study, load_study
from gelforge.shipped import EXAMPLES

CAMERAS = Path("config/cameras")
PLAN_KEY = re.compile(r"^plan:[^\n]*", re.MULTILINE)
NO_CAMERA = "camera: null # none is known of this sensor; docs/cameras.md has how to describe yours\n"


def sensor_files(sensor: str) -> list[Path]:
    """Return the files that describe a shipped sensor: its YAML file and its surfaces."""
    surfaces = shipped_study(sensor).sensor.shape.files.values()
    return [Path(f"config/sensors/{sensor}.yaml"), *surfaces]


def study_of_sensor(study: str, sensor: str) -> dict[Path, str]:
    """Return the files of a new study of a shipped sensor with their text: its smoke study renamed, and a session's head."""
    shipped = shipped_study(sensor)
    config = (EXAMPLES / SMOKE / f"{sensor}.yaml").read_text()
    config = config.replace(f"{SMOKE.as_posix()}/{sensor}.yaml", f"config/{study}.yaml")
    config = config.replace(f"study: {shipped.study}\n", f"study: {study}\n")
    config = PLAN_KEY.sub("plan: # of recorded sessions: {from: sessions}", config)
    camera = EXAMPLES / CAMERAS / f"{sensor}.yaml"
    described = camera.read_text() if camera.is_file() else NO_CAMERA
    session = session_files(study, shipped.indenter.words, described)
    return {Path("config") / f"{study}.yaml": config, **session}


def sensors(name: str | None, out: Path | None) -> None:
    """List the shipped sensors, or draw one of them, or that of a study's YAML file."""
    from gelforge.report.figures.simulation.cross_section import cross_section

    if name is None:
        for sensor in sensor_names():
            print(f"{sensor:15} {sensor_line(shipped_study(sensor))}")
        print("a study of one: gelforge init mine --sensor NAME; its picture: gelforge sensors NAME")
        return
    is_file = name.endswith((".yaml", ".yml"))
    study = load_study(name) if is_file else shipped_study(name)
    stem = Path(name).stem
    with nullcontext() if is_file else chdir(EXAMPLES):  # surfaces are read from there
        figure = cross_section(study, stem)
    target = out or Path(f"{stem}.png")
    figure.savefig(target, dpi=100)
    print(target)


def sensor_line(study: Study) -> str:
    """Return a sensor's form, size, layers and what presses it in one line."""
    sensor = study.sensor
    layers = ", ".join(f"{layer.name} {layer.thickness_mm:g} mm" for layer in sensor.layers)
    size = f"{sensor.width_x_mm:g} x {sensor.width_y_mm:g} mm"
    return f"{sensor.shape.kind}, {size}: {layers}; {study.indenter.words}"
