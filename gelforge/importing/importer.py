"""Raw logs to a session, step by step; what was found stays at hand for the page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gelforge.config import Session, section_from
from gelforge.config.foreign.importing import Clock, ImportMapping, StageSource, Surface, load_import
from gelforge.importing.camera import Film, read_film
from gelforge.importing.clocks import Match, Signal, coarse_match
from gelforge.importing.presses import Presses, depth_zero_mm, find_presses
from gelforge.importing.refusals import ImportingError
from gelforge.importing.revisits import repeatability_mm
from gelforge.importing.session_files import FORCE, Frames, place_of, rows_of_presses, write_session
from gelforge.importing.stage_motion import Excursion, excursions
from gelforge.importing.streams import Stream, read_force, read_stage
from gelforge.importing.turning_points import Bends, ClockLaw, clock_law, find_bends, refined_lag
from gelforge.indentation.planning.tolerance import tolerance_of_stage_mm
from gelforge.recording.readings import force_on_sensor


@dataclass(frozen=True)
class Aligned:
    """How a source stands to the stage's clock: its coarse match, law and bends."""

    match: Match
    law: ClockLaw
    bends: Bends
    start_s: float  # what its clock shows at its first row, less what the stage's shows at its own

    @property
    def lag_s(self) -> float:
        """Return how much later its clock shows the same moment than the stage's [s]."""
        return self.start_s + self.law.lag_s


@dataclass(frozen=True)
class Imported:
    """Everything that was found in the logs of one session."""

    mapping: ImportMapping
    session: Session
    stage: Stream
    excursions: list[Excursion]
    force: Stream
    force_s: np.ndarray  # (m,) on the stage's clock
    push_N: np.ndarray  # (m,) towards the gel
    force_clock: Aligned
    film: Film | None
    frames: Frames | None
    camera_clock: Aligned | None
    presses: Presses
    zero_mm: np.ndarray  # (P,) travel at depth zero
    table: pd.DataFrame
    images: dict[str, int]

    @property
    def contacts(self) -> pd.DataFrame:
        """Return a row per indentation: number, contact point with its interval, depth zero; on the stage's axis [mm]."""
        sign = -1 if self.mapping.stage.pressing == "-z" else 1
        rows = []
        for press, zero in zip(self.presses.kept, self.zero_mm):
            low, high = sorted((sign * press.contact.low_mm, sign * press.contact.high_mm))
            rows.append(
                {
                    "press": f"p{press.number:03d}",
                    "number": press.number,
                    "touch_s": press.touch_s,
                    "contact_mm": sign * press.contact.travel_mm,
                    "contact_low_mm": low,
                    "contact_high_mm": high,
                    "depth_zero_mm": sign * zero,
                    "depth_mm": press.top_mm[2] - zero,
                    "peak_N": press.peak_N,
                    "exponent": press.contact.exponent,
                }
            )
        return pd.DataFrame(rows)


def import_logs(mapping_file: str | Path, name: str, data: Path | None = None) -> Imported:
    """Return the session that the logs of a mapping hold.

    Parameters
    ----------
    mapping_file : str or Path
        YAML that says what the logs' columns mean.
    name : str
        Of the session.
    data : Path, optional
        Folder of the logs; None for that of the mapping.

    Returns
    -------
    Imported
        Session, logs on the stage's clock [s], indentations and their contact points [mm].

    Raises
    ------
    ImportingError
        For logs that are of two sessions, clocks that cannot be aligned, and indentations that are cut or slip. The
        message names the key that settles it.
    ConfigError
        For a mapping that is not valid.
    """
    path = Path(mapping_file)
    mapping, folder = load_import(path), data or path.parent
    session = _session(mapping, name, {}, str(path))  # refused before anything is read
    stage = read_stage(folder, mapping.stage, mapping.force)
    force = read_force(folder, mapping.force, mapping.stage)
    film = read_film(folder, mapping.camera) if mapping.camera else None
    moves = excursions(stage.time_s, stage.values, mapping.least_retreat_mm, mapping.least_dwell_s)
    push = -force_on_sensor(force.values, session.force)[:, 2]
    clock = _aligned(stage, moves, force, push, mapping.force, "force", None, mapping.stage)
    force_s, camera_clock, frames = clock.law.on_stage(force.time_s), None, None
    if film and mapping.camera:
        source = Stream(film.path, film.start_s, film.time_s, film.change[:, None])
        camera_clock = _aligned(
            stage, moves, source, film.change, mapping.camera, "camera", clock.match.contact_mm, mapping.stage
        )
        frames = Frames(film, camera_clock.law.on_stage(film.time_s))
    presses = find_presses(
        stage,
        moves,
        force_s,
        push,
        clock.match.contact_mm,
        (frames.time_s[0], frames.time_s[-1]) if frames else None,
        mapping.skip,
        mapping.incomplete == "drop",
    )
    zero = depth_zero_mm(presses.kept, mapping.depth_zero, mapping.stage.pressing, mapping.contact_within_mm)
    deep = np.array([press.top_mm[2] for press in presses.kept]) - zero
    if deep.min() <= 0:
        press = presses.kept[int(deep.argmin())]
        raise ImportingError(
            f"indentation {press.number} at {press.top_s:.1f} s reaches {deep.min():.3f} mm only; set depth_zero: press, or"
            f" leave it out with skip: [{press.number}]"
        )
    repeats = session.stage_to_sensor.repeatability_mm
    if repeats is None:
        repeats = repeatability_mm(np.array([place_of(press) for press in presses.kept]))
    tolerance = tolerance_of_stage_mm(repeats)
    table, images = rows_of_presses(presses.kept, zero, stage, frames, mapping, tolerance)
    found_zero = _depth_zero(mapping, presses)
    notes = _notes(mapping, clock, camera_clock, presses)
    found_stage = {} if repeats is None else {"repeatability_mm": round(repeats, 5)}
    keys = {"depth_zero": found_zero, "stage_to_sensor": found_stage, "notes": notes}
    session = _session(mapping, name, keys, str(path))
    return Imported(
        mapping, session, stage, moves, force, force_s, push, clock, film, frames, camera_clock, presses, zero, table, images
    )  # fmt: skip


def write_imported(folder: str | Path, imported: Imported) -> None:
    """Write a session's folder, and import.csv with its contact points.

    Parameters
    ----------
    folder : str or Path
        The session's folder.
    imported : Imported
        As `import_logs` returns it.
    """
    folder = Path(folder)
    log = pd.DataFrame(imported.force.values, columns=FORCE)
    log.insert(0, "time_s", np.round(imported.force_s, 6))
    write_session(folder, imported.session, imported.table, log, imported.images, imported.film)
    imported.contacts.to_csv(folder / "import.csv", index=False, float_format="%.6g")


def _session(mapping: ImportMapping, name: str, keys: dict[str, Any], source: str) -> Session:
    """Return session.yaml: what the mapping says holds before what was found."""
    said = dict(mapping.session)
    stage = {key: value for key, value in (said.get("stage_to_sensor") or {}).items() if value is not None}
    both = {
        "depth_zero": {**keys.get("depth_zero", {}), **(said.get("depth_zero") or {})},
        "stage_to_sensor": {**keys.get("stage_to_sensor", {}), **stage},
    }
    notes = "; ".join(text for text in (str(said.get("notes") or ""), keys.get("notes", "")) if text)
    return section_from(Session, {**said, **both, "session": name, "notes": notes}, f"{source}: session")


def _aligned(
    stage: Stream,
    moves: list[Excursion],
    log: Stream,
    signal: np.ndarray,
    clock: Clock,
    key: str,
    level: float | None,
    stage_clock: StageSource,
) -> Aligned:
    """Return the clock of a log whose signal (n,) grows with depth."""
    what, start = str(log.path), log.start_s - stage.start_s
    moved, shown = Signal(stage.time_s, stage.values[:, 2]), Signal(log.time_s, signal)
    known = None if clock.lag_s is None else clock.lag_s - start

    def bends_at(match: Match) -> Bends:
        return find_bends(moved, moves, shown, match, match.contact_mm if level is None else level)

    match = coarse_match(
        moved, shown, what, key, start, known, lambda match: refined_lag(bends_at(match), match.lag_s)
    )
    bends = bends_at(match)
    # of a log without stamps of its own None: rows of it may be lost without a trace
    stamps = (log.time_s if stamped(clock) else None, stage.time_s if stamped(stage_clock) else None)
    return Aligned(match, clock_law(bends, known, clock.drift, what, key, stamps), bends, start)


def stamped(clock: Clock | StageSource) -> bool:
    """Return whether each row of a log has a time stamp of its own."""
    return not (clock.rate_hz or clock.even or getattr(clock, "gcode", None))


def _depth_zero(mapping: ImportMapping, presses: Presses) -> dict[str, Any]:
    """Return the keys of session.yaml's depth_zero: how it was found, and its scatter [mm]."""
    contacts_mm = np.array([press.contact.travel_mm for press in presses.kept])
    error_mm = float(np.median([press.contact.sd_mm for press in presses.kept]))
    if mapping.depth_zero == "press":
        return {
            "by": "press",
            "how": "contact point of each indentation, from force over travel",
            "press_scatter_mm": round(error_mm, 5),
        }
    spread = float(np.std(contacts_mm, ddof=1)) if len(contacts_mm) > 1 else error_mm
    # What the points scatter by beyond the errors they were found with is that of the surface and the stage.
    beyond = max(spread**2 - error_mm**2, spread**2 / len(contacts_mm))
    keys = {"by": "session", "press_scatter_mm": round(float(np.sqrt(beyond)), 5)}
    if isinstance(mapping.depth_zero, Surface):
        return keys | {"how": f"the laboratory's own, at {mapping.depth_zero.at_mm:g} mm of the stage"}
    how = f"median contact point of {len(contacts_mm)} indentations, from force over travel"
    return keys | {"how": how, "session_scatter_mm": round(spread / np.sqrt(len(contacts_mm)), 5)}


def _notes(mapping: ImportMapping, force: Aligned, camera: Aligned | None, presses: Presses) -> str:
    parts = [f"imported: {mapping.describes}", clock_words("force", force)]
    parts += [clock_words("camera", camera)] if camera else []
    parts += [f"indentation {number} left out ({why})" for number, _, why in presses.left_out]
    return "; ".join(parts)


def clock_words(name: str, clock: Aligned) -> str:
    """Return the law of a clock in words.

    Parameters
    ----------
    name : str
        Of the source.
    clock : Aligned
        Its clock against the stage's.

    Returns
    -------
    str
        Lag [s], twice its standard error [ms] and rate [ppm].
    """
    rate = f", gains {clock.law.rate * 1e6:.1f} ppm" if clock.law.rate else ""
    known = f" +- {2 * clock.law.se_s * 1e3:.1f} ms" if clock.law.se_s else " (given)"
    return f"{name} clock {clock.lag_s:.4f} s later than the stage's{known}{rate}"
