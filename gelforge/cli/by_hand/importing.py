"""`gelforge import`: raw logs to a session folder with a page that draws what was done; `import-set`: public sets."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from gelforge.cli.study.add_session import add_session, check_place, unjoined
from gelforge.config import NAME, Sensor, load_study
from gelforge.config.foreign.named_images import NamesMapping, load_names
from gelforge.importing.importer import Imported, clock_words, import_logs, write_imported
from gelforge.importing.named_images import write_named
from gelforge.importing.public import layout_of
from gelforge.importing.public.labelled import Options, write_labelled
from gelforge.importing.refusals import ImportingError
from gelforge.importing.streams import Stream
from gelforge.indentation.sensor.stage_frame import first_outside, stage_to_sensor
from gelforge.recording.readings import Recording, read_recording
from gelforge.recording.tables.checks import RecordingError
from gelforge.report.figures.measurements.import_figure import import_figure


def import_command(mapping: Path, out: Path, study: Path | None = None, data: Path | None = None) -> None:
    """Write the session folder `out` from the logs that a mapping describes; print what was found.

    The folder appears when it is whole and its session is accepted. Of one that is refused only the page is left.
    study: the YAML file of a study that is to read the session (gelforge/cli/study/add_session.py). data: folder of the
    logs, None: the mapping's.
    """
    name = out.resolve().name
    if not NAME.fullmatch(name):
        raise ImportingError(f"--out {out}: {name!r} is not a name; use letters, digits, '_' and '-'")
    if os.path.lexists(out):
        raise ImportingError(f"--out {out}: exists already; remove it or name another folder")
    if study:
        check_place(load_study(study), study, out)
    if named := load_names(mapping):
        _import_named(mapping, named, out, data or mapping.parent, study)
        return
    imported = import_logs(mapping, name, data)
    for line in lines(imported):
        print(line)
    if study:
        check_frame(mapping, imported, load_study(study).sensor)
    page = out.parent / f"{name}.import.png"
    with _appearing(out) as folder:
        write_imported(folder, imported)
        import_figure(imported, folder).savefig(page, dpi=110)
        recording = _accepted(mapping, folder, f", and {page} shows what was done")
        os.replace(page, folder / "import.png")
    for line in recording.findings.lines():
        print(f"finding    {line}")
    print(f"session    {out}: {len(imported.table)} readings, {len(imported.images)} images")
    print(f"page       {out / 'import.png'}: look at it")
    _added(study, out)


@contextmanager
def _appearing(out: Path) -> Iterator[Path]:
    """Yield a folder of that name in a temporary folder next to it, and move it there when it is whole."""
    out.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".import-", dir=out.parent) as temporary:
        folder = Path(temporary) / out.resolve().name
        folder.mkdir()
        yield folder
        shutil.move(folder, out)


def _accepted(mapping: Path, folder: Path, shown: str) -> Recording:
    """Return the session that was written, as all commands read it. Raises ImportingError where they refuse it."""
    try:
        return read_recording(folder)
    except RecordingError as error:
        said = str(error).replace(f"{folder}{os.sep}", "").replace(f"{folder}: ", "")
        raise ImportingError(
            f"{mapping}: the session is refused ({said}); its keys stand under `session` of the mapping{shown}"
        ) from None


def _import_named(mapping: Path, named: NamesMapping, out: Path, data: Path, study: Path | None) -> None:
    """Write the session of a folder of images whose names hold the numbers."""
    with _appearing(out) as folder:
        count = write_named(folder, named, folder.name, data, str(mapping))
        recording = _accepted(mapping, folder, "")
    print(f"session    {out}: {len(recording.readings)} readings, {count} images")
    _added(study, out)


def _added(study: Path | None, out: Path) -> None:
    """Let a study read a session, and say what comes next."""
    if study:
        for line in [*add_session(study, out.resolve().name), *unjoined(study, out)]:
            print(line)
        print(f"next       gelforge check {study}")


def check_frame(mapping: Path, imported: Imported, sensor: Sensor) -> None:
    """Raise ImportingError for positions outside a study's sensor, before a session is written."""
    xy = stage_to_sensor(imported.table[["x_mm", "y_mm"]].to_numpy(), imported.session.stage_to_sensor)
    if wrong := first_outside(xy, (sensor.width_x_mm, sensor.width_y_mm)):
        press = imported.table["press"].iloc[wrong[0]]
        raise ImportingError(f"{mapping}: indentation {press}: {wrong[1]}")


def import_set(layout: str, source: Path, out: Path, columns: list[str], unit: str, every: int) -> None:
    """Write the images of a public set with their forces into a new folder, and say why it is no session."""
    if os.path.lexists(out):
        raise ImportingError(f"--out {out}: exists already; remove it or name another folder")
    if every < 1:
        raise ImportingError(f"--every {every}: at least 1; 10 takes every tenth reading")
    if wrong := [text for text in columns if text.count("=") != 1]:
        raise ImportingError(f"--columns {wrong[0]}: a pair NAME=COLUMN is needed, as fx=Fx")
    chosen = layout_of(layout)
    options = Options(dict(text.split("=") for text in columns), unit)
    with _appearing(out) as folder:
        written = write_labelled(chosen, source, folder, options, every)
    largest = ", ".join(f"{force:.3g}" for force in written.largest_N)
    print(f"set        {chosen.what}")
    print(
        f"readings   {written.images} images in {written.groups} groups, forces up to {largest} N (x, y, z of the set)"
    )
    print(f"force      {chosen.force}")
    print(f"reference  {chosen.reference}: {written.references} written")
    print(f"no session {chosen.lacks}")
    print(f"possible   gelforge predict {out / 'images'} --model MODEL, against {out / 'readings.csv'}")
    print(f"licence    {chosen.licence}")


def lines(imported: Imported) -> list[str]:
    """Return what was found, a line each."""
    points = imported.contacts
    out = [
        f"stage      {rows_words(imported.stage)}",
        f"force      {rows_words(imported.force)}: {match_words('force', imported.force_clock)}",
    ]
    if imported.film:
        film = imported.film
        out.append(f"camera     {len(film.time_s)} frames: {match_words('camera', imported.camera_clock)}")
    half = (points["contact_high_mm"] - points["contact_low_mm"]) / 2
    out.append(
        f"presses    {len(points)}, contact at {points['contact_mm'].median():.3f} mm of the stage (scatter"
        f" {points['contact_mm'].std():.3g} mm, each +- {half.median():.2g} mm), depths {points['depth_mm'].min():.3f} to"
        f" {points['depth_mm'].max():.3f} mm, forces {points['peak_N'].min():.3g} to {points['peak_N'].max():.3g} N"
    )
    out += [
        f"left out   press {number} at {at:.1f} s: {why}" for number, at, why in imported.presses.left_out
    ]
    if imported.presses.untouched_s:
        at = ", ".join(f"{time:.1f}" for time in imported.presses.untouched_s[:5])
        out.append(
            f"untouched  {len(imported.presses.untouched_s)} motions without force, no presses: at {at} s"
        )
    return out


def rows_words(log: Stream) -> str:
    return f"{len(log.time_s)} rows in {log.time_s[-1]:.1f} s, one every {log.period_s * 1e3:.3g} ms"


def match_words(name: str, clock) -> str:
    """Return the law of a clock with its correlation and the next best lag, in words."""
    rival = clock.match.rival
    other = f", next {rival[1]:.3f} at {clock.start_s + rival[0]:.2f} s" if rival else ""
    return f"{clock_words(name, clock)} (correlation {clock.match.correlation:.3f}{other})"
