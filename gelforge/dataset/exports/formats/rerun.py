"""Rerun: a recording that opens as the force field over the image."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from gelforge.config import Camera
from gelforge.dataset.exports.card import card
from gelforge.dataset.exports.export import Export, Options, library
from gelforge.dataset.exports.source import IMAGE, Press, Source
from gelforge.files import write_text
from gelforge.indentation.sensor.unrolled import bin_points
from gelforge.progress import tracked
from gelforge.recording.optics.camera import project

PACKAGE = "rerun-sdk"  # of 170 MB: not in the extra
# N of a bin that is drawn as long as a bin is wide (no result depends on it).
FULL = 0.05
USE = """\
`rerun FOLDER/train.rrd` (or validation, test) opens the recording: the image with the force of each bin over it, the same
in space, and the resultant over the rows. An arrow as long as a bin is wide is {full:g} N. In Python:

```python
from rerun.chunk import RrdReader

store = RrdReader("FOLDER/train.rrd").store()
```

Rows follow each other along the timeline `row`, press after press; shards hold no times."""


def write(source: Source, folder: Path, options: Options) -> None:
    """Write a recording per split."""
    rr, layout = library("rerun", PACKAGE, PACKAGE), library("rerun.blueprint", PACKAGE, PACKAGE)
    views = [
        layout.Spatial2DView(origin="camera", name="force over the image"),
        layout.Spatial3DView(origin="sensor", name="force on the sensor [mm]"),
        layout.TimeSeriesView(origin="resultant", name="resultant [N]"),
    ]
    for split in source.counts:
        name = f"{source.manifest['study']}-{split}"
        recording = rr.RecordingStream("gelforge", recording_id=name)
        recording.save(folder / f"{split}.rrd", layout.Blueprint(layout.Horizontal(*views)))
        row = 0
        for press in tracked(source.of_split(split), f"indentations of {split} exported"):
            row = _log(rr, recording, source, press, row)
        recording.flush()
        recording.disconnect()
    write_text(folder / "README.md", card(source, USE.format(full=FULL), options))


def _log(rr, recording, source: Source, press: Press, row: int) -> int:
    """Log the rows of an indentation; return the number of the next row."""
    rows = source.read([press])
    points = bin_points(source.sensor)
    scale = source.sensor.width_x_mm / source.sensor.bins.nx / FULL  # mm per N
    pixels_of = None if source.manifest["labels_only"] else _projection(source, press.name.split("/")[0])
    for i, forces in enumerate(rows["force_distribution_N"].astype(float)):
        recording.set_time("row", sequence=row + i)
        drawn = np.abs(forces).max(axis=1) > 1e-4  # N
        at, arrow = points[drawn], scale * forces[drawn]
        recording.log("sensor/forces", rr.Arrows3D(origins=at, vectors=arrow))
        recording.log("label/forces_3d", rr.Tensor(forces, dim_names=("bin", "axis")))
        recording.log(
            "state/press", rr.TextLog(f"{press.name} {rows['phase'][i]} {rows['depth_mm'][i]:g} mm")
        )
        for axis, value in zip("xyz", rows["total_force_fem_N"][i]):
            recording.log(f"resultant/f{axis}_N", rr.Scalars(float(value)))
        if source.images:
            content = rows[IMAGE][i]
            kind = "image/png" if content.startswith(b"\x89PNG") else "image/jpeg"
            recording.log("camera/image", rr.EncodedImage(contents=content, media_type=kind))
        if pixels_of:
            # what pushes into the sensor is seen by its size only: the camera looks along z
            along = arrow * [1, 1, 0]
            start, end = pixels_of(at), pixels_of(at + along)
            size = np.abs(forces[drawn, 2])
            radii = 0.5 + 5 * np.sqrt(size / FULL)
            recording.log("camera/pressure", rr.Points2D(start, radii=radii, colors=[255, 160, 0, 120]))
            recording.log(
                "camera/forces", rr.Arrows2D(origins=start, vectors=end - start, colors=[255, 0, 0])
            )
    return row + len(press.rows)


def _projection(source: Source, session: str):
    """Return the function from points (n, 3) [mm] to pixels (n, 2) of a session's images; None where it has no camera."""
    view = source.manifest["sessions"].get(session, {}).get("view") or {}
    if not view.get("camera"):
        return None
    camera = Camera.model_validate(view["camera"])
    return lambda points: project(camera, points)[0] if len(points) else np.empty((0, 2))


EXPORT = Export(
    "rerun",
    "a `.rrd` per split: forces and resultant in space, over the image with `--images` and a camera; "
    "`pip install rerun-sdk`, `rerun FOLDER/train.rrd`",
    write,
)
