"""From a material test whose rows name pictures to a table with stretches (and the apex radius of a membrane).

Tension: `time_s, force_N, image`. Inflation: `time_s, pressure_kPa, top_image, side_image`. Pictures lie next to the
CSV (or in a folder that the names give); the first row shows the undeformed piece. samples.csv may state, per sample,
the window to be tracked and the patch in pixels of the first picture; an inflation needs the side view's mm_per_px.
Rows without a trusted stretch are left out, each with its reason.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.csv_table import TableError, read_csv
from gelforge.materials.basis.statistics import ROWS_OF_CURVE
from gelforge.materials.imaging.apex_shape import SilhouetteError, apex_shape, flat_row_px
from gelforge.progress import tracked

PICTURE_COLUMNS = ("image", "top_image", "side_image")
WINDOW_COLUMNS = ("window_x_px", "window_y_px", "window_width_px", "window_height_px")
# of samples.csv, all optional
PICTURE_SETTINGS = (*WINDOW_COLUMNS, "patch_px", "mm_per_px", "camera_distance_mm")


def has_pictures(path: str | Path) -> bool:
    """Return whether the stretches of a sample's file are to be tracked in the pictures that its rows name."""
    header = read_csv(path).columns
    return "stretch_1" not in header and any(name in header for name in PICTURE_COLUMNS)


def picture_files(path: str | Path) -> list[Path]:
    """Return the pictures that a sample's file names, each once; none where its stretches are given."""
    if not has_pictures(path):
        return []
    table = read_csv(path)
    names = [name for c in PICTURE_COLUMNS if c in table for name in table[c] if name]
    return [Path(path).parent / name for name in dict.fromkeys(names)]


def tracked_tension(path: Path, settings: pd.Series) -> tuple[pd.DataFrame, list[str]]:
    """Return time_s, force_N, stretch_1, stretch_2 of a strip's pictures, index as in the file, and findings."""
    from gelforge.materials.imaging.stretch_tracking import WINDOW_OF_STRIP

    table = read_csv(path, numbers=("time_s", "force_N"), optional_texts=("image",))
    return _tracked(path, table, "image", settings, degree=1, share=WINDOW_OF_STRIP)


def tracked_inflation(path: Path, settings: pd.Series) -> tuple[pd.DataFrame, list[str]]:
    """Return time_s, pressure_kPa, apex_radius_mm, stretch_1, stretch_2 of a membrane's views, and findings.

    With camera_distance_mm D (top camera's pupil to the clamp) the stretches are divided by D / (D - height): the apex
    comes closer to the camera by its height. Without it the top view is taken as telecentric, and the findings say so.
    """
    from gelforge.materials.imaging.stretch_tracking import WINDOW_OF_MEMBRANE

    table = read_csv(path, numbers=("time_s", "pressure_kPa"), optional_texts=("top_image", "side_image"))
    mm_per_px = float(settings.get("mm_per_px", np.nan))
    if not mm_per_px > 0:
        stated = "missing" if np.isnan(mm_per_px) else f"{mm_per_px:g}"
        raise TableError(
            f"{path.parent / 'samples.csv'}: mm_per_px of {path.name} is {stated}; the radius in the side view needs"
            " the size of a pixel in the plane of the apex, add the column (above 0)"
        )
    table, said = _tracked(path, table, "top_image", settings, degree=3, share=WINDOW_OF_MEMBRANE)
    shapes, left_out = {}, []
    side_rows = table.index[table["side_image"] != ""]
    if not len(side_rows):
        raise TableError(f"{path}: side_image is empty in every tracked row; name the side views")
    flat = None
    for line in side_rows:
        picture = _picture(path, line, table.at[line, "side_image"])
        try:
            flat = flat_row_px(picture) if flat is None else flat
            shapes[line] = apex_shape(picture, mm_per_px)
        except SilhouetteError as error:
            left_out.append(f"row {line} ({table.at[line, 'side_image']}): {error}")
    left_out += [f"row {line}: no side_image" for line in table.index.difference(side_rows)]
    said += _left_out(path, left_out)
    _check_enough(path, len(shapes), left_out)
    table = table.loc[list(shapes)]
    table["apex_radius_mm"] = [s.radius_mm for s in shapes.values()]
    distance = float(settings.get("camera_distance_mm", np.nan))
    if np.isnan(distance):
        said.append(f"{path.name}: no camera_distance_mm, the top view is taken as telecentric")
        return table, said
    if flat is None:
        raise TableError(f"{path}: no side view shows where the membrane is clamped; add one that does")
    height = np.array([(flat - s.apex_px[1]) * mm_per_px for s in shapes.values()])
    if not distance > 2 * height.max():
        raise TableError(
            f"{path.parent / 'samples.csv'}: camera_distance_mm of {path.name} is {distance:g}, the apex is"
            f" {height.max():.3g} mm high; more than twice that is expected, from the camera's pupil to the clamp in mm"
        )
    magnification = distance / (distance - height)
    table[["stretch_1", "stretch_2"]] = table[["stretch_1", "stretch_2"]].div(magnification, axis=0)
    said.append(
        f"{path.name}: stretches divided by up to {magnification.max():.4f}, the apex nears the top camera"
    )
    return table, said


def _tracked(
    path: Path, table: pd.DataFrame, column: str, settings: pd.Series, degree: int, share: tuple[float, float]
) -> tuple[pd.DataFrame, list[str]]:
    """Return the rows of a table whose picture has a trusted stretch, with stretch_1 and stretch_2, and findings."""
    from gelforge.materials.imaging import stretch_tracking as tracking

    named = table[table[column] != ""]
    said = (
        [f"{path.name}: {len(table) - len(named)} rows without {column} left out"]
        if len(named) < len(table)
        else []
    )
    if not len(named):
        raise TableError(f"{path}: {column} is empty in every row; name the pictures or give stretch_1")
    lines = {name: line for line, name in reversed(list(named[column].items()))}  # first row of each picture
    names = list(dict.fromkeys(named[column]))
    first = _picture(path, lines[names[0]], names[0])

    def frames():
        for name in names:
            picture = _picture(path, lines[name], name)
            if picture.shape != first.shape:
                raise TableError(
                    f"{path}, row {lines[name]}: {name} has {picture.shape[1]} x {picture.shape[0]} px, the first"
                    f" picture {first.shape[1]} x {first.shape[0]}; one camera setting per test is expected"
                )
            yield picture

    stated = [float(settings.get(c, np.nan)) for c in WINDOW_COLUMNS]
    patch = float(settings.get("patch_px", np.nan))
    chosen = tracking.TrackingSettings(
        degree=degree, **({} if np.isnan(patch) else {"patch_px": int(patch) | 1})
    )
    try:
        window = tracking.textured_window(first, share) if np.isnan(stated).any() else stated
        pictures = tracked(frames(), f"pictures of {path.name} tracked", len(names))
        track = tracking.track_stretches(pictures, window, chosen)
    except tracking.TrackingError as error:
        raise TableError(
            f"{path}: {error}; the window is stated by {', '.join(WINDOW_COLUMNS)} in samples.csv"
        ) from None
    x, y, width, height = track.window_px
    how = "found by its texture" if np.isnan(stated).any() else "as stated"
    said.append(
        f"{path.name}: stretches tracked in {len(names)} pictures, window x {x:.0f}, y {y:.0f}, {width:.0f} x"
        f" {height:.0f} px {how}; largest standard error {np.nanmax(track.standard_error):.2%}"
    )
    lost = [f"row {lines[names[f.frame]]} ({names[f.frame]}): {f.reason}" for f in track.lost]
    said += _left_out(path, lost)
    _check_enough(path, len(names) - len(lost), lost)
    at = named[column].map({name: k for k, name in enumerate(names)}).to_numpy()
    named = named.assign(stretch_1=track.stretch[at, 0], stretch_2=track.stretch[at, 1])
    return named[np.isfinite(named["stretch_1"])], said


def _picture(path: Path, line: int, name: str) -> np.ndarray:
    from gelforge.materials.imaging.stretch_tracking import TrackingError, read_grey

    try:
        return read_grey(path.parent / name)
    except TrackingError as error:
        raise TableError(f"{path}, row {line}: {error}; add the picture or empty the cell") from None


def _left_out(path: Path, reasons: list[str]) -> list[str]:
    if not reasons:
        return []
    more = f"; and {len(reasons) - 5} more" if len(reasons) > 5 else ""
    return [f"{path.name}: {len(reasons)} rows left out: {'; '.join(reasons[:5])}{more}"]


def _check_enough(path: Path, number: int, reasons: list[str]) -> None:
    if number < ROWS_OF_CURVE:
        raise TableError(
            f"{path}: {number} pictures could be measured, {ROWS_OF_CURVE} at least are needed; the first that could not:"
            f" {reasons[0] if reasons else 'none'}. Speckle the piece finely, light it evenly, or take frames more often"
        )
