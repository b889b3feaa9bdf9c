"""Judge a recording against a study, say what a plan could show, and what to record next."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.cli.study.cost import Costs
from gelforge.config import Study, load_study
from gelforge.files import write_table
from gelforge.progress import Stages, stage

if TYPE_CHECKING:
    from gelforge.mismatch.fem.solutions import Solver


def mismatch(
    what: str, config: Path, out: Path | None, laws: list[Path], kept: Path | None, workers: int, page: bool
) -> None:
    """Judge a recording; or, with `limits` or `plan` in its place, look ahead."""
    from gelforge.mismatch.pipeline.stage import solver_of

    study = load_study(config)
    folder = out or study.results_folder / "mismatch"
    if ahead := {"limits": limits, "plan": plan}.get(what):
        ahead(solver_of(study, folder, laws, kept, workers, []), folder)
    else:
        judge(study, Path(what), folder, laws, kept, workers, page)


def judge(
    study: Study, recording: Path, out: Path, laws: list[Path], kept: Path | None, workers: int, page: bool
) -> None:
    """Write verdict.json, its tables, patch and, if asked, page, and print the verdict."""
    from gelforge.mismatch.pipeline.stage import SOLUTIONS, judge_folder

    solutions = kept or out / SOLUTIONS
    some_kept = solutions.is_dir() and any(solutions.iterdir())
    with Stages("verdict", expected_seconds(study, workers), at_most=some_kept):
        verdict = judge_folder(study, recording, out, laws, kept, workers)
        if page:
            from gelforge.report.mismatch_page import write_mismatch_page

            stage("page")
            write_mismatch_page(out)
    print(f"{verdict.state}: {verdict.sentence}")
    print(f"next: {verdict.next_step}")
    print(f"written to {out}")


def expected_seconds(study: Study, workers: int) -> float:
    """Return how long a verdict on a study's sessions is expected to take [s], where nothing of it is solved yet."""
    from gelforge.indentation.planning.plan import plan_cells

    return Costs(study, plan_cells(study)).mismatch() / workers


def limits(solver: Solver, out: Path) -> None:
    """Print and write what the study's plan could detect, and print what it could not be asked of."""
    from gelforge.mismatch.pipeline.experiments import limits_table, planned_problem
    from gelforge.mismatch.summary.words import uncomputed

    with Stages("what the plan could show"):
        problem = planned_problem(solver)
        stage("detection limits")
        table = limits_table(problem)
    write_table(out, "limits", table)
    print(table.to_string(index=False, float_format="%.3g"))
    for sentence in [*problem.observations.cannot_know, *uncomputed(problem)]:
        print(sentence)


def plan(solver: Solver, out: Path) -> None:
    """Print and write the experiments that would distinguish a verdict's surviving effects, the first to be made first."""
    from gelforge.mismatch.pipeline.experiments import experiments_table
    from gelforge.mismatch.result.verdict import read_verdict
    from gelforge.mismatch.result.verdict_tables import check_tables

    verdict = read_verdict(out)
    check_tables(out, verdict)
    with Stages("experiments that would distinguish effects"):
        table = experiments_table(solver, verdict)
    write_table(out, "experiments", table)
    print(table.to_string(index=False, float_format="%.3g"))
