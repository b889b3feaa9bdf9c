"""Judge a recording against a study, say what a plan could show, and what to record next."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, Study, load_session, load_study
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.progress import Stages, stage, tracked


def mismatch(
    what: str, config: Path, out: Path | None, laws: list[Path], kept: Path | None, workers: int, page: bool
) -> None:
    """Judge a recording; or, with `limits` or `plan` in its place, look ahead."""
    study = load_study(config)
    folder = out or study.results_folder / "mismatch"
    if what == "limits":
        limits(study, folder, laws, kept, workers)
    elif what == "plan":
        plan(study, folder, laws, kept, workers)
    else:
        judge(study, Path(what), folder, laws, kept, workers, page)


def judge(
    study: Study, recording: Path, out: Path, laws: list[Path], kept: Path | None, workers: int, page: bool
) -> None:
    """Write verdict.json, its tables, patch and, if asked, page, and print the verdict."""
    from gelforge.mismatch.pipeline.stage import check_matches, judge_recording
    from gelforge.mismatch.readings.sessions import session_folders

    own = recording.resolve() == study.data_folder.resolve()  # of its own data a study chooses the sessions
    folders = session_folders(recording, study.sessions if own else ())
    check_matches(folders, study)
    solver = solver_of(study, out, laws, kept, workers, folders)
    with Stages("verdict", expected_seconds(study, workers)):
        verdict = judge_recording(solver, folders, out, f"{recording.name} against study {study.study}")
        if page:
            from gelforge.report.mismatch_page import write_mismatch_page

            stage("page")
            write_mismatch_page(out)
    print(f"{verdict.state}: {verdict.sentence}")
    print(f"written to {out}")


def expected_seconds(study: Study, workers: int) -> float:
    """Return how long a verdict on a study's sessions is expected to take [s], where nothing of it is solved yet."""
    from gelforge.cli.cost import Costs
    from gelforge.indentation.plan import plan_cells

    return Costs(study, plan_cells(study)).mismatch() / workers


def limits(study: Study, out: Path, laws: list[Path], kept: Path | None, workers: int) -> None:
    """Print and write what the study's plan could detect, and print what it could not be asked of."""
    from gelforge.files import write_table
    from gelforge.mismatch.pipeline.ahead import limits_table, planned_problem
    from gelforge.mismatch.summary.words import uncomputed

    with Stages("what the plan could show"):
        problem = planned_problem(solver_of(study, out, laws, kept, workers, []))
        stage("detection limits")
        table = limits_table(problem)
    write_table(out, "limits", table)
    print(table.to_string(index=False, float_format="%.3g"))
    for sentence in [*problem.observations.cannot_know, *uncomputed(problem)]:
        print(sentence)


def plan(study: Study, out: Path, laws: list[Path], kept: Path | None, workers: int) -> None:
    """Print and write the experiments that would tell a verdict's survivors apart, the first one to be made first."""
    from gelforge.files import write_table
    from gelforge.mismatch.pipeline.ahead import experiments_table
    from gelforge.mismatch.result.verdict import read_verdict

    with Stages("experiments that would tell effects apart"):
        table = experiments_table(solver_of(study, out, laws, kept, workers, []), read_verdict(out))
    write_table(out, "experiments", table)
    print(table.to_string(index=False, float_format="%.3g"))


def sensitivities(study: Path, cell: str, laws: list[Path], out: Path) -> None:
    """Solve the derivatives of one site's forces and write them into a file."""
    from gelforge.indentation.plan import plan_cells
    from gelforge.mismatch.fem.site_slopes import slopes_of_site, write_site_slopes

    described = load_study(study)
    cells = plan_cells(described)
    if cell not in cells:
        raise ConfigError(f"{study}: the plan has no cell {cell!r}")
    solver = solver_of(described, out.parent, laws, None, 1, [])
    site = slopes_of_site(solver, cells[cell])
    write_site_slopes(out, solver, site)
    missing = [f"{key}: {one}" for key, one in site.found.items() if isinstance(one, str)]
    print(f"{cell}: {len(site.found) - len(missing)} derivatives at {len(site.planned.depths_mm)} depths")
    for line in missing:
        print(f"no derivative along {line}")


def solver_of(
    study: Study, out: Path, laws: list[Path], kept: Path | None, workers: int, folders: list[Path]
):
    """Return the finite elements of a study; where every session calls the constants exact, its laws are certain."""
    from gelforge.mismatch.fem.solutions import Solver

    if workers < 1:
        raise ConfigError(f"--workers {workers}: 1 or more are needed")
    by_material, uncertain = laws_and_doubts(material_laws_of(study, laws))
    sessions = [load_session(folder / "session.yaml") for folder in folders]
    if sessions and all(session.base_parameters == "exact" for session in sessions):
        uncertain = {}
    study = study.model_copy(update={"variants": {}})  # an effect need not go together with them
    cells = study.results_folder / "cells"
    zeroed = {session.depth_zero.by for session in sessions}
    stored = study.results_folder / "sensitivities"
    return Solver(
        study,
        by_material,
        uncertain,
        kept or out / "solves",
        cells if cells.is_dir() else None,
        workers,
        zeroed.pop() if len(zeroed) == 1 else "press",
        stored if stored.is_dir() else None,
    )


def published(config: Path, out: Path, workers: int) -> None:
    """Judge the article's own readings against its two curves and against our cells, and print the verdicts."""
    from dataclasses import replace

    from gelforge.mismatch.pipeline.published import CASES, judge_case, study_of, write_summary
    from gelforge.report.mismatch_page import write_mismatch_page

    study, verdicts = load_study(config), {}
    solver = replace(solver_of(study, out, [], None, workers, []), cells=None, uncertain={})
    for case in tracked(CASES, "cases judged"):
        verdicts[case.name] = judge_case(case, replace(solver, study=study_of(case, study)), out)
        write_mismatch_page(out / case.name)
        print(f"{case.title}: {verdicts[case.name].state}: {verdicts[case.name].sentence}")
    write_summary(out, verdicts)
