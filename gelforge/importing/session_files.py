"""The session folder: session.yaml, indentations.csv, ft.csv, images, and import.csv with a row per indentation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Session, write_yaml
from gelforge.config.foreign.importing import ImportMapping
from gelforge.importing.camera import Film, write_frames
from gelforge.importing.presses import Press
from gelforge.importing.refusals import ImportingError
from gelforge.importing.streams import Stream
from gelforge.indentation.paths.places import POSITION_MATCH_MM, gaps_to, within

# Before the stage leaves, no reading. A frame of 30 per second takes 0.033 s: no image shows the stage moving
# (tests/importing/test_session_folder.py).
LEAVING_S = 0.03
# Of readings on a ramp, which ends in one of its own. Ten times the 0.005 mm by which depths count as different; ramps
# keep one reading at the top (tests/importing/test_one_table.py).
CLEAR_OF_TOP_MM = 0.05
COLUMNS = ["press", "cell", "order", "time_s", "phase", "x_mm", "y_mm", "depth_mm", "speed_mm_per_s", "dwell_s",
           "fx_N", "fy_N", "fz_N", "image"]  # fmt: skip
FORCE = ["fx_N", "fy_N", "fz_N"]


@dataclass(frozen=True)
class Frames:
    """The film on the stage's clock."""

    film: Film
    time_s: np.ndarray  # (n,)

    def near(self, at_s: float) -> tuple[int, float]:
        """Return the number and time of the frame nearest to a time."""
        k = int(np.abs(self.time_s - at_s).argmin())
        return k, float(self.time_s[k])


def rows_of_presses(
    presses: tuple[Press, ...],
    zero_mm: np.ndarray,
    stage: Stream,
    frames: Frames | None,
    mapping: ImportMapping,
    tolerance_mm: float = POSITION_MATCH_MM,
) -> tuple[pd.DataFrame, dict[str, int]]:
    """Return the readings, columns as in COLUMNS without forces, and the number of the frame that each image shows.

    tolerance_mm: within which the waits of an indentation are at one position.
    """
    rows, images = [], {}
    for order, (press, zero) in enumerate(zip(presses, zero_mm)):
        of_press = _rows(press, zero, stage, frames, mapping, tolerance_mm)
        for number, row in enumerate(of_press):
            row |= {"press": f"p{press.number:03d}", "cell": "", "order": order, "image": ""}
            if (frame := row.pop("frame", None)) is not None:
                row["image"] = f"{row['press']}_{number:02d}_{row['phase']}.png"
                images[row["image"]] = frame
        rows += of_press
    table = pd.DataFrame(rows).reindex(columns=COLUMNS)
    return table, images


def _rows(
    press: Press,
    zero: float,
    stage: Stream,
    frames: Frames | None,
    mapping: ImportMapping,
    tolerance_mm: float,
) -> list[dict]:
    xy = np.round(place_of(press), 3)
    rows = [_zero_row(zero, stage, at, xy) for at in np.linspace(*press.zero_s, 5)[1:-1]]
    if frames:
        k, at = frames.near(rows[-1]["time_s"])
        if not press.zero_s[0] <= at <= press.zero_s[1]:
            raise ImportingError(
                f"indentation {press.number}: no frame in its zero phase; leave it out with skip: [{press.number}]"
            )
        rows[-1] = _zero_row(zero, stage, at, xy) | {"frame": k}
        rows.sort(key=lambda row: row["time_s"])
    if not press.waits:
        frame: int | None = None
        at = press.top_s
        if frames:
            frame, at = frames.near(press.top_s)
        loading, unloading = _ramp_rows(press, zero, stage, xy, mapping.ramp_depths_mm)
        rows += [*loading, _row("load", at, xy, press.top_mm[2] - zero, frame=frame), *unloading]
    deepest, sideways = -np.inf, False
    for wait in press.waits:
        depth = round(wait.travel_mm - zero, 3)
        moved = not within(gaps_to(wait.at_mm[:2], xy)[0], tolerance_mm)
        sideways |= moved
        phase = "shear" if moved else "unload" if depth < deepest - 0.005 else "load"
        if phase == "load" and sideways:
            phase = "shear"
        deepest = max(deepest, depth)
        place = np.round(wait.at_mm[:2], 3) if phase != "load" else xy
        rows += _wait_rows(press, wait, phase, place, depth, frames, mapping)
    if press.waits and rows[-1]["phase"] != "unload":
        rows += _leaving_row(press, zero, stage, rows[-1])
    return rows


def place_of(press: Press) -> np.ndarray:
    """Return where an indentation was made (2,) [mm], as the stage logged it: at its first wait, else at its deepest."""
    return (press.waits[0].at_mm if press.waits else press.top_mm)[:2]


def _ramp_rows(press: Press, zero: float, stage: Stream, xy, depths_mm: list[float]) -> tuple[list, list]:
    """Return the readings of loading and of unloading where the stage passes depths, without those near the deepest."""
    out: tuple[list[dict], list[dict]] = ([], [])
    first, top, last = press.excursion.first, press.excursion.top, press.excursion.last
    ways = ((np.arange(first, top + 1), "load", 1), (np.arange(top, last + 1), "unload", -1))
    for (number, phase, sign), rows in zip(ways, out, strict=True):
        time, depth = stage.time_s[number], sign * (stage.values[number, 2] - zero)
        pressed = sign * depth > 0
        speed = np.polyfit(time[pressed], depth[pressed], 1)[0] if pressed.sum() > 1 else np.nan
        for wanted in sorted(sign * d for d in depths_mm if d < press.top_mm[2] - zero - CLEAR_OF_TOP_MM):
            k = int((depth >= wanted).argmax())  # the first row at or beyond it
            if not k or not depth[k] >= wanted:
                continue
            at = np.interp(wanted, depth[k - 1 : k + 1], time[k - 1 : k + 1])
            if at < press.end_s:
                rows.append(_row(phase, at, xy, sign * wanted, speed))
    return out


def _row(phase, at, xy, depth, speed=np.nan, dwell=np.nan, frame=None) -> dict:
    row = {
        "time_s": round(float(at), 5),
        "phase": phase,
        "x_mm": xy[0],
        "y_mm": xy[1],
        "depth_mm": round(float(depth), 4),
        "speed_mm_per_s": round(float(speed), 4),
        "dwell_s": round(float(dwell), 4),
    }
    return row if frame is None else row | {"frame": frame}


def _zero_row(zero, stage, at, xy) -> dict:
    depth = float(np.interp(at, stage.time_s, stage.values[:, 2])) - zero
    return _row("zero", at, xy, min(depth, 0.0))


def _wait_rows(press, wait, phase, xy, depth, frames, mapping) -> list[dict]:
    """Return the reading at arrival and those of the wait, with a frame each where there is a film."""
    arrive = wait.arrive_s if np.isfinite(wait.arrive_s) else press.touch_s
    leave = wait.leave_s if np.isfinite(wait.leave_s) else press.end_s
    rows = [_row(phase, arrive, xy, depth, wait.speed_mm_per_s, 0.0)]
    times = np.linspace(arrive + mapping.settle_s, leave - LEAVING_S, mapping.frames_per_dwell)
    chosen: list[tuple[int | None, float]] = [(None, float(at)) for at in times]
    if frames:
        inside = np.flatnonzero((frames.time_s >= times[0] - 1e-9) & (frames.time_s <= leave - LEAVING_S))
        few = (
            inside[np.unique(np.linspace(0, len(inside) - 1, mapping.frames_per_dwell).astype(int))]
            if len(inside)
            else []
        )
        if not len(few):
            raise ImportingError(
                f"indentation {press.number} at {arrive:.1f} s: no frame while it waits ({leave - arrive:.2f} s); leave it"
                f" out with skip: [{press.number}], or lower settle_s"
            )
        chosen = [(int(k), float(frames.time_s[k])) for k in few]
    waiting = "dwell" if phase == "load" else phase
    return rows + [_row(waiting, at, xy, depth, wait.speed_mm_per_s, at - arrive, k) for k, at in chosen]


def _leaving_row(press, zero, stage, last: dict) -> list[dict]:
    """Return the reading where the stage passes half of the last depth on its way back; none where the log is too coarse."""
    half = zero + 0.5 * last["depth_mm"]
    after = np.flatnonzero((stage.time_s > last["time_s"]) & (stage.values[:, 2] <= half))
    if not len(after):
        return []
    k = after[0]
    (t0, t1), (s0, s1) = stage.time_s[k - 1 : k + 1], stage.values[k - 1 : k + 1, 2]
    at = t0 + (half - s0) / (s1 - s0) * (t1 - t0)
    if at >= press.end_s or at - last["time_s"] < LEAVING_S:
        return []
    return [_row("unload", at, (last["x_mm"], last["y_mm"]), half - zero)]


def write_session(
    folder: Path,
    session: Session,
    table: pd.DataFrame,
    log: pd.DataFrame,
    images: dict[str, int],
    film: Film | None,
) -> None:
    """Write the session into an empty folder; log: ft.csv; images: the frame of each, the first one is the reference."""
    forces = log[FORCE].to_numpy()
    seen = np.stack([np.interp(table["time_s"], log["time_s"], axis) for axis in forces.T], axis=1)
    table.assign(**dict(zip(FORCE, seen.T))).to_csv(
        folder / "indentations.csv", index=False, float_format="%.9g"
    )
    log.to_csv(folder / "ft.csv", index=False, float_format="%.9g")
    write_yaml(folder / "session.yaml", session)
    if film is None:
        return
    (folder / "images").mkdir()
    wanted: dict[int, list[Path]] = {}
    for name, number in images.items():
        wanted.setdefault(number, []).append(folder / "images" / name)
    wanted[next(iter(images.values()))].append(folder / "reference.png")
    write_frames(film, wanted)
