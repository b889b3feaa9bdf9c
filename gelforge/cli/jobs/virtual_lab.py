"""Jobs of a virtual lab, whose data are SYNTHETIC: material tests, sites of the true sensor, sessions."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import planned_cell, print_outcome, truth_folder, virtual_lab_of
from gelforge.config import ConfigError, load_study


def virtual_materials(study: Path, material: str | None) -> None:
    """Write the SYNTHETIC raw material tests of the study's virtual lab."""
    from gelforge.virtual_lab.material_tests import make_material_tests

    described = load_study(study)
    lab = virtual_lab_of(described, study)
    if material is not None:
        lab = lab.model_copy(update={"materials": {material: lab.materials[material]}})
    make_material_tests(lab, described.data_folder / "materials")


def virtual_cell(study: Path, cell: str, out: Path, fresh: bool = False) -> None:
    """Write one cell of the virtual sensor's truth, solved or taken up; fresh: see simulate."""
    from gelforge.indentation.cells.kept_solutions import solved_once
    from gelforge.virtual_lab.truth import simulate_truth_cell, truth_digest

    described = load_study(study)
    lab, planned = virtual_lab_of(described, study), planned_cell(described, cell)
    inputs = truth_digest(described, lab, planned)
    truth, how = solved_once(out, inputs, lambda: simulate_truth_cell(described, lab, planned), fresh)
    print_outcome(cell, truth, how)


def virtual_session(study: Path, session: str, workers: int) -> None:
    """Write one SYNTHETIC session folder of the study's virtual lab."""
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.virtual_lab.session import make_session

    described = load_study(study)
    lab = virtual_lab_of(described, study)
    by_name = {entry.session: entry for entry in lab.sessions}
    if session not in by_name:
        raise ConfigError(f"{described.virtual_lab}: no session {session!r}; it has {sorted(by_name)}")
    folder = described.session_folder(session)
    make_session(
        lab, by_name[session], described, plan_cells(described), truth_folder(described), folder, workers
    )
