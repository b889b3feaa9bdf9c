"""Jobs of a simulated training set: presses that are solved once, and rows drawn from them."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.products import study_laws
from gelforge.config import ConfigError, Study, load_study
from gelforge.laws_of_study import laws_and_doubts


def solve(study: Path, number: int, laws: list[Path], out: Path) -> None:
    """Solve one press of the study's simulated training set, and say what became of it."""
    from gelforge.indentation.cells.cell_file import write_cell
    from gelforge.synthesis.draws import solution, solution_count
    from gelforge.synthesis.rows import solve as solved

    described = _with_synthesis(study)
    _check_number(study, "press", number, solution_count(described))
    one = solution(described, number)
    cell = solved(one, laws_and_doubts(study_laws(described, laws))[0])
    write_cell(out, cell)
    reason = "" if cell.converged else f", ended early: {cell.attributes['reason']}"
    print(f"{one.planned.name}: {one.study.indenter.words}, {len(cell.arrays['depth_mm'])} steps{reason}")


def synthesise(study: Path, number: int, solved: list[Path], out: Path) -> None:
    """Write the rows of one shard of the study's simulated training set."""
    from gelforge.synthesis.draws import shard_count
    from gelforge.synthesis.rows import write_rows

    described = _with_synthesis(study)
    _check_number(study, "shard", number, shard_count(described))
    print(write_rows(described, number, solved, out))


def _with_synthesis(study: Path) -> Study:
    described = load_study(study)
    if described.synthesis is None:
        raise ConfigError(f"{study}: the study has no synthesis; describe a simulated training set there")
    return described


def _check_number(study: Path, what: str, number: int, count: int) -> None:
    if not 0 <= number < count:
        raise ConfigError(f"{study}: {what} {number} does not exist; the study has 0 to {count - 1}")
