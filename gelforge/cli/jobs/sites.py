"""Jobs of a study's sites: the plan as a table, and one site or one session solved."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gelforge.cli.jobs.interpolation import between_site
from gelforge.cli.products import planned_cell, print_outcome, session_of, session_presses, study_laws
from gelforge.config import ConfigError, Study, load_study, session_study, variant_study
from gelforge.laws_of_study import laws_and_doubts


def plan(study: Path, out: Path) -> None:
    """Write the study's cells as a table."""
    from gelforge.files import write_text
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.planning.plan_table import plan_table

    write_text(out, plan_table(plan_cells(load_study(study))).to_csv(index=False, lineterminator="\n"))


def simulate(
    study: Path,
    cell: str,
    laws: list[Path],
    variant: str | None,
    session: str | None,
    out: Path,
    fresh: bool = False,
    between: bool = False,
) -> None:
    """Write one cell, solved, mirrored or taken up; one that does not converge is written as failed, with its reason.

    fresh: solve also what an earlier job has solved from the same inputs. between: the cell is one of the sites between
    which labels are interpolated.
    """
    from gelforge.dataset.session_labels import check_digest
    from gelforge.indentation.cells.cell_file import read_cell, write_cell
    from gelforge.indentation.cells.kept_solutions import solved_once
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.inputs import inputs_digest, solution_digest
    from gelforge.indentation.solving.mirror import mirror_cell

    described = load_study(study)
    planned = (
        between_site(described, plan_cells(described), cell) if between else planned_cell(described, cell)
    )
    if session:
        planned = replace(planned, between="")  # pressed sites of a session are solved or mirrored
    if planned.between:
        raise ConfigError(
            f"cell {cell} is interpolated between solved sites and not solved itself; it comes with `gelforge derive`"
        )
    if variant:
        described, planned = variant_study(described, variant), replace(planned, source=None, symmetry=None)
    cells = described.results_folder / "cells"
    if session:
        described = session_study(described, session_of(described, session))
        cells = described.results_folder / "sessions" / session / "cells"
    read = study_laws(described, laws)
    by_material = {name: law.law for name, law in read.items()}
    if planned.source:
        source, original = cells / f"{planned.source}.h5", planned_cell(described, planned.source)
        solved, expected = read_cell(source), replace(original, between="")
        check_digest(source, expected.name, solved, inputs_digest(described, by_material, expected))
        result, how = mirror_cell(solved, described, by_material, planned), "mirrored"
        write_cell(out, result)
    else:
        inputs = solution_digest(described, by_material, planned, laws)
        result, how = solved_once(out, inputs, lambda: labelled(described, read, planned), fresh)
    print_outcome(cell, result, how)


def simulate_session(study: Path, session: str, laws: list[Path], out: Path, fresh: bool = False) -> None:
    """Write the labels of a session's presses, one after another on a sensor that softens; fresh: from the first on."""
    from gelforge.dataset.presses_in_order import discard_part, press_in_order  # loads the compiled kernels

    described = session_study(load_study(study), session_of(load_study(study), session))
    if not described.mechanics.effects.history.softens:
        raise ConfigError(
            f"{study}: nothing softens, so presses need not be followed in order; give mechanics.effects.history.mullins"
        )
    known, doubts = laws_and_doubts(study_laws(described, laws))
    presses = session_presses(described, session)
    if fresh:
        discard_part(out)
    reason = press_in_order(described, known, doubts, presses, session, out)
    print(f"{session}: {len(presses)} presses" + (f"; ended early: {reason}" if reason else ""))


def labelled(study: Study, read: dict, planned):
    """Return a solved cell with its error bars; read: files of laws by material."""
    from gelforge.indentation.solving.companion import simulate_label  # loads the compiled kernels

    ranges = {name: law.valid_range for name, law in read.items()}
    outside = {name: valid.outside for name, valid in ranges.items() if valid is not None}
    return simulate_label(study, *laws_and_doubts(read), planned, outside)
