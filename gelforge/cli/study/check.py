"""`gelforge check`: a study and all that it reads."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path

from gelforge.cli.camera.pose import scale_line
from gelforge.cli.extras import missing_for_onnx
from gelforge.cli.products import print_findings, virtual_lab_of
from gelforge.cli.study.cost import estimate
from gelforge.cli.study.split_and_sessions import check_split, print_unnamed
from gelforge.config import ConfigError, Session, Study, load_session, load_study
from gelforge.laws_of_study import known_laws, law_path


class CheckFailed(ValueError):
    """What a check found wrong, a line for each."""


def check(study: Path, picture: Path | None) -> None:
    """Check a study and all that it reads, draw it, and print cells, minutes and disk; name what is missing.

    Raises CheckFailed with everything that is wrong, not the first alone. A study is called valid where its data are there
    and nothing in them is doubtful.
    """
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.planning.stability_ahead import check_stable_ahead
    from gelforge.indentation.sensor.sizes import indenter_words
    from gelforge.materials.fitting.stiffness import stiffness_words
    from gelforge.report.figures.simulation.sensor_figure import sensor_figure

    described = load_study(study)
    cells = plan_cells(described)
    errors: list[str] = []
    if described.virtual_lab:
        with noted(errors):
            check_lab(described, study, cells)
    if described.learning.onnx and (words := missing_for_onnx()):
        errors.append(words)
    missing = missing_files(described)
    doubtful = check_data(described, cells, missing, errors) + check_split(described, cells)
    laws = known_laws(described, [])
    for name, material in laws.items():
        print(f"material   {name}: {type(material.law).__name__}, {stiffness_words(material.law)}")
    for name in described.materials:
        if name not in laws:
            print(
                f"material   {name}: no constitutive model yet, it is fitted by snakemake {law_path(described, name)}"
            )
    for line in indenter_words(described.indenter):
        print(f"indenter   {line}")
    if {layer.material for layer in described.sensor.layers} <= set(laws):
        with noted(errors):
            check_stable_ahead(described, {name: material.law for name, material in laws.items()}, cells)
    if not errors:  # else what is drawn and estimated would rest on what is wrong
        out = picture or described.results_folder / "check.png"
        out.parent.mkdir(parents=True, exist_ok=True)
        sensor_figure(described, cells, pictured_session(described, study)).savefig(out, dpi=110)
        for line in estimate(described, cells):
            print(line)
        print(f"picture    {out}")
    for name in missing:
        print(f"missing    {name}")
    if errors:
        raise CheckFailed("\n".join(errors))
    print(f"{study}: {verdict_of_check(len(missing), doubtful)}")


def check_lab(study: Study, path: Path, cells: dict) -> None:
    """Refuse a virtual lab that is wrong, or a path that it could not record."""
    from gelforge.virtual_lab.truth import check_recordable

    virtual_lab_of(study, path)
    for planned in cells.values():
        check_recordable(planned)


@contextmanager
def noted(errors: list[str]):
    """Take note of an error of ours instead of ending; an error of another kind passes."""
    try:
        yield
    except ValueError as error:
        if not type(error).__module__.startswith("gelforge."):
            raise
        errors.append(str(error))


def verdict_of_check(missing: int, doubtful: int) -> str:
    """Return the last words of a check that found no error: valid only where nothing is missing or doubtful."""
    words = [f"incomplete, {missing} file(s) to be added"] if missing else []
    words += [f"{doubtful} finding(s) above to be looked at"] if doubtful else []
    return "; ".join(words) or "valid"


def missing_files(study: Study) -> list[str]:
    """Return the raw files that the study needs and that are not there; a virtual lab makes its own."""
    from gelforge.csv_table import read_csv

    missing: list[Path] = []
    for material in study.materials.values():
        if material.mapping:
            missing += [path for path in (material.tests, material.mapping) if path and not path.exists()]
        elif material.file:
            missing += [] if material.file.exists() else [material.file]
        elif material.tests:
            samples = material.tests / "samples.csv"
            names = read_csv(samples, texts=("file",))["file"] if samples.is_file() else ["samples.csv"]
            missing += [material.tests / name for name in names if not (material.tests / name).is_file()]
    for name in [] if study.virtual_lab else study.sessions:
        folder = study.session_folder(name)
        needed = ["session.yaml", "indentations.csv"]
        described = folder / "session.yaml"
        if not described.is_file() or load_session(described).camera:
            needed += ["reference.png", "images"]
        missing += [folder / part for part in needed if not (folder / part).exists()]
    return [path.as_posix() for path in missing]


def check_data(study: Study, cells: dict, missing: list[str], errors: list[str]) -> int:
    """Read every material and session that is complete; return how many findings are doubtful.

    What is wrong in one is added to errors, and the next is read.
    """
    from gelforge.materials.readers.material_source import source_of
    from gelforge.recording.copies import check_copies

    doubtful = 0
    pressed: set[str] = set()
    for name, material in study.materials.items():
        if material.tests and not any(path.startswith(material.tests.as_posix() + "/") for path in missing):
            with noted(errors):
                tests = source_of(name, material.tests, material.mapping).tests
                print(f"material   {name}: {len(tests)} samples")
    for name in study.sessions:
        folder = study.session_folder(name)
        if not folder.is_dir() or any(path.startswith(folder.as_posix() + "/") for path in missing):
            made = study.virtual_lab is not None
            print(f"session    {name}: {'made by the virtual lab, SYNTHETIC' if made else 'incomplete'}")
            continue
        with noted(errors):
            findings, here = check_session(study, name, cells)
            doubtful, pressed = doubtful + findings, pressed | here
    print_unnamed(study)
    if not study.virtual_lab:
        with noted(errors):
            check_copies({name: study.session_folder(name) for name in study.sessions})
    if pressed and (never := len(cells) - len(pressed)):
        print(
            f"plan       {never} of {len(cells)} positions are pressed in no session: their labels have no reading"
        )
    return doubtful


def check_session(study: Study, name: str, cells: dict) -> tuple[int, set[str]]:
    """Read a session, print its counts next to the plan's and what its tests found; return number of findings and cells.

    Raises RecordingError or ConfigError for one that cannot be right.
    """
    from gelforge.recording.imaging.flow import ImageError
    from gelforge.recording.optics.camera import CameraError
    from gelforge.recording.optics.remap import picture_of
    from gelforge.recording.readings import read_recording
    from gelforge.recording.tables.join import press_table

    folder = study.session_folder(name)
    recording = read_recording(folder, cells, study.sensor)
    readings, presses = recording.readings, press_table(recording.readings)
    here = set(presses["cell"]) - {""}
    depths = len(presses.drop_duplicates(["cell", "depth_mm"]))
    planned = sum(len(cells[cell].depths_mm) for cell in here)
    print(
        f"session    {name}: {len(presses)} presses, {(readings['image'] != '').sum()} images; {len(here)} of the plan's"
        f" {len(cells)} positions, {depths} depths there of {planned} planned"
    )
    print_findings(recording)
    if recording.session.camera:
        try:
            picture_of(recording.session)  # refuses a remap that shows too little, before anything is solved
            print_scale(study, name, recording.session)
        except (ImageError, CameraError) as error:
            raise ConfigError(f"{folder / 'session.yaml'}: {error}") from None
    return len(recording.findings.lines("excluded", "note")), here


def print_scale(study: Study, name: str, session: Session) -> None:
    """Print the scale of the images whose flow is searched, on the plane of the particles or else of the top surface."""
    from gelforge.recording.camera_pose import particle_plane_mm
    from gelforge.recording.optics.camera import CameraError
    from gelforge.recording.optics.remap import seen_by

    try:
        plane, of = particle_plane_mm(study.sensor), "the particles' mean"
    except CameraError:
        plane, of = 0.0, "the undeformed top"
    print(scale_line(seen_by(session), plane) + f" ({of}), session {name}")


def pictured_session(study: Study, path: Path) -> Session | None:
    """Return the session whose camera is drawn: the first that is described, or the virtual lab's."""
    for name in study.sessions:
        described = study.session_folder(name) / "session.yaml"
        if described.is_file():
            return load_session(described)
    return (
        Session(session="virtual", camera=virtual_lab_of(study, path).camera) if study.virtual_lab else None
    )
