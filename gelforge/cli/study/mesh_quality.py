"""What the qualities of the mesh are known to err by: Fz on the shipped sensors against a mesh of half the default sizes.

mesh_errors.csv holds the measurements; `python benchmarks/qualities.py --update` makes it anew.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.api.studies import sensor as shipped_study
from gelforge.api.studies import sensors as sensor_names
from gelforge.config import Mesh, Sensor, Study
from gelforge.files import write_text

if TYPE_CHECKING:
    import pandas as pd

MEASURED = Path(__file__).with_name("mesh_errors.csv")
DEPTHS = 4  # of every measured indentation
TEXTS = ("sensor", "quality")
NUMBERS = {  # column: decimals
    "near_mm": 4,
    "far_mm": 4,
    "degrees_of_freedom": 0,
    "error_percent": 2,  # largest |Fz / reference - 1|
    "sigma_percent": 2,  # largest stated standard deviation over Fz
    "error_over_sigma": 2,  # largest
    "cpu_s": 2,
}


def read_mesh_errors(path: Path = MEASURED) -> pd.DataFrame:
    """Return the tested meshes: sensor, quality, sizes [mm], unknowns, errors of Fz, CPU seconds of DEPTHS depths."""
    from gelforge.csv_table import read_csv

    return read_csv(path, numbers=tuple(NUMBERS), texts=TEXTS)


def write_mesh_errors(rows: list[dict], where: str, path: Path = MEASURED) -> None:
    """Write tested meshes; where says on which machine, in words."""
    lines = [
        f"# errors of Fz and CPU seconds of {DEPTHS} depths with error bars, by `python benchmarks/qualities.py --update`",
        f"# {where}",
        ",".join([*TEXTS, *NUMBERS]),
        *(
            ",".join([*(row[name] for name in TEXTS), *(f"{row[name]:.{n}f}" for name, n in NUMBERS.items())])
            for row in rows
        ),
    ]
    write_text(path, "\n".join(lines) + "\n")


def mesh_error_words(study: Study, tested: pd.DataFrame | None = None) -> str:
    """Return the tested error of Fz of a study's mesh: of its sensor and sizes, else of all shipped sensors."""
    tested = read_mesh_errors() if tested is None else tested
    tested = tested[tested["quality"] == study.mechanics.mesh.quality]
    name, used = shipped_name(study.sensor), study.mechanics.mesh.used
    if study.sensor.shape.kind == "block" and used.elements == "tetrahedra":
        name = None  # blocks are tested with hexahedra
    same = tested[
        (tested["sensor"] == name)
        & tested["near_mm"].round(3).eq(round(used.near_mm, 3))
        & tested["far_mm"].round(3).eq(round(used.far_mm, 3))
    ]
    if len(same):
        error, near = same["error_percent"].max(), reference_mesh(study).near_mm
        return f"Fz within {error:.1f} % of a mesh of {near:g} mm (tested on {name})"
    low, high = tested["error_percent"].min(), tested["error_percent"].max()
    return f"not tested; on shipped sensors Fz within {low:.1f} to {high:.1f} % of a finer mesh"


def reference_mesh(study: Study) -> Mesh:
    """Return the mesh whose forces count as true: half the default sizes of a block, half the study's of other shapes."""
    given = study.mechanics.mesh
    radius = max(given.near_radius_mm, Mesh().near_radius_mm)
    mesh = Mesh(near_radius_mm=radius) if study.sensor.shape.kind == "block" else given
    return mesh.model_copy(update={"quality": "standard"}).coarser(1 / 2)


def shipped_name(sensor: Sensor) -> str | None:
    """Return the name of the shipped sensor of this geometry; None: it is another's."""
    of_same = (name for name in sensor_names() if geometry(shipped_study(name).sensor) == geometry(sensor))
    return next(of_same, None)


def geometry(sensor: Sensor) -> tuple:
    """Return what a sensor's mesh is made of."""
    thicknesses = tuple(layer.thickness_mm for layer in sensor.layers)
    return sensor.width_x_mm, sensor.width_y_mm, sensor.shape, thicknesses, sensor.wall_mm, sensor.flange
