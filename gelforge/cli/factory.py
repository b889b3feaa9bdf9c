"""The commands that the workflow runs: read, one call, write."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from gelforge.config import (
    ConfigError,
    Study,
    load_study,
    load_virtual_lab,
    session_study,
    variant_study,
)
from gelforge.laws_of_study import law_path, laws_and_doubts

ARTICLES_STUDY, ARTICLES_NUMBERS = (
    "paper",
    Path("data/paper"),
)  # which study's report shows them, and where they are


def fit_law(study: Path, material: str, out: Path) -> None:
    """Write the law of a material, its curves, tables and measured effects."""
    from gelforge.materials.characterise import characterise

    described = load_study(study)
    if material not in described.materials:
        raise ConfigError(f"{study}: no material {material!r}; it has {sorted(described.materials)}")
    characterise(material, described.materials[material], out, described.study)


def plan(study: Path, out: Path) -> None:
    """Write the study's cells as a table."""
    from gelforge.files import write_text
    from gelforge.indentation.planning.plan import plan_cells, plan_table

    write_text(out, plan_table(plan_cells(load_study(study))).to_csv(index=False, lineterminator="\n"))


def simulate(
    study: Path,
    cell: str,
    laws: list[Path],
    mirrored: list[Path],
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
    from gelforge.indentation.solving.inputs import inputs_digest, solution_digest
    from gelforge.indentation.solving.mirror import mirror_cell

    described = load_study(study)
    planned = solved_between(described, cell) if between else planned_cell(described, cell)
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
        source = mirrored[0] if mirrored else cells / f"{planned.source}.h5"
        solved, expected = read_cell(source), replace(planned_cell(described, planned.source), between="")
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


def readings(study: Path, session: str, out: Path) -> None:
    """Write a session's readings: force on the sensor in the sensor's frame, zero subtracted; and what its tests found."""
    from gelforge.recording.plausibility.findings import write_findings
    from gelforge.recording.readings import write_readings

    described = load_study(study)
    recording = recording_of(described, session)
    write_readings(out, recording)
    write_findings(out.with_suffix(".findings.csv"), recording.findings)
    print_findings(recording)


def features(study: Path, session: str, out: Path, workers: int) -> None:
    """Write the optical-flow features of a session's images."""
    from gelforge.recording.features import found_in, session_features

    described = load_study(study)
    recording = recording_of(described, session)
    count = session_features(recording, described.features, out, workers)
    print_findings(recording)
    for line in found_in(out):
        print(f"{'of all':<10} {session}: {line}")
    print(f"{session}: {count} images")


def join(study: Path, shard: int, out: Path) -> None:
    """Write one shard: a fixed chunk of the plan, every cell checked against the present settings and laws."""
    from gelforge.dataset.join import join_shard
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.inputs import inputs_digest
    from gelforge.recording.features import features_digest

    described = load_study(study)
    planned, size = plan_cells(described), described.dataset.cells_per_shard
    chunk = list(planned)[shard * size : (shard + 1) * size]
    if not chunk:
        raise ConfigError(
            f"shard {shard}: the plan's {len(planned)} cells fill {-(-len(planned) // size)} shards of {size}"
        )
    laws = read_laws(described)
    features = {name: feature_path(described, name) for name in image_sessions(described)}
    rows = join_shard(
        described,
        chunk,
        {name: cell_path(described, name) for name in chunk},
        features,
        out,
        {name: inputs_digest(described, laws, planned[name]) for name in chunk},
        {
            name: features_digest(
                described.session_folder(name), session_of(described, name), described.features
            )
            for name in features
        },
        own_labels(described, {name: planned[name] for name in chunk}, laws),
    )
    print(f"{out}: {rows} rows" + ("" if features else " (labels only: the study has no images)"))


def manifest(study: Path) -> None:
    """Write manifest, checksums, card and Croissant description beside the shards."""
    from gelforge.dataset.manifest import describe_dataset

    described = load_study(study)
    features = {name: feature_path(described, name) for name in image_sessions(described)}
    describe_dataset(described, shard_paths(described), features, described.results_folder / "dataset")


def agreement(study: Path, out: Path) -> None:
    """Write total forces, simulated beside measured, one row per press."""
    from gelforge.dataset.agreement import agreement_table, write_agreement
    from gelforge.files import digest
    from gelforge.indentation.planning.plan import plan_cells

    described = load_study(study)
    recorded = {name: described.results_folder / "recordings" / f"{name}.csv" for name in described.sessions}
    planned = plan_cells(described)
    cells = {name: cell_path(described, name) for name in planned}
    laws = read_laws(described)
    digests, raw = agreement_inputs(described, laws)
    own = own_labels(described, planned, laws)
    table = agreement_table(recorded, cells, own, digests, raw)
    write_agreement(out, table, digest([digests, raw]))


def tables(study: Path) -> None:
    """Write the article's tables from laws, agreement and predictions; the labels' ranges where nothing is predicted."""
    from gelforge.dataset.agreement import read_agreement, rmse_gt_table
    from gelforge.dataset.ranges import force_ranges_table, label_ranges
    from gelforge.files import digest, write_table
    from gelforge.materials.fitting.material_table import material_table

    described = load_study(study)
    results, folder = described.results_folder, described.results_folder / "tables"
    laws = own_laws(described)
    write_table(folder, "material", material_table(laws))
    if described.sessions:
        resolution = {name: session_of(described, name).force.resolution_N for name in described.sessions}
        inputs = digest(list(agreement_inputs(described, {law.material: law.law for law in laws})))
        agreed = read_agreement(results / "agreement.csv", inputs)
        write_table(folder, "rmse_gt", rmse_gt_table(agreed, resolution))
    if image_sessions(described):
        from gelforge.learning.judging import evaluation
        from gelforge.learning.judging.error_budget import error_budget_table
        from gelforge.learning.judging.predictions import Predictions  # labels alone need no PyTorch

        predictions = Predictions(results / "model" / "predictions.h5")
        predictions.check_model(results / "model" / "model.pt")
        write_table(folder, "rmse", evaluation.rmse_table(predictions))
        write_table(folder, "baselines", evaluation.baselines_table(predictions))
        write_table(folder, "errors_by", evaluation.errors_by_table(predictions))
        write_table(folder, "reliability", evaluation.reliability_table(predictions))
        budget = error_budget_table(predictions)
        if budget is not None:
            write_table(folder, "error_budget", budget)
        else:  # none of earlier predictions is left beside these
            for suffix in ("csv", "md"):
                (folder / f"error_budget.{suffix}").unlink(missing_ok=True)
            if described.virtual_lab is not None:
                print(f"no error budget: {predictions.path} holds no truth; evaluate the model again")
        ranges = predictions.label_range
    else:
        ranges = label_ranges(shard_paths(described))
    write_table(folder, "force_ranges", force_ranges_table(ranges))


def report(study: Path, out: Path) -> None:
    """Write the study's offline page, and say what it had to leave out."""
    from gelforge.report.page import write_report

    described = load_study(study)
    article = ARTICLES_NUMBERS if described.study == ARTICLES_STUDY else None
    for words in write_report(described, described.results_folder, out, article):
        print(words)


# ------------------------------------------------------------------------------------- what commands share
def labelled(study: Study, read: dict, planned):
    """Return a solved cell with its error bars; read: files of laws by material."""
    from gelforge.indentation.solving.companion import simulate_label  # loads the compiled kernels

    ranges = {name: law.valid_range for name, law in read.items()}
    outside = {name: valid.outside for name, valid in ranges.items() if valid is not None}
    return simulate_label(study, *laws_and_doubts(read), planned, outside)


def print_outcome(cell: str, result, how: str) -> None:
    """Say in the log what became of a cell, and whether it was solved now."""
    reason = f" {result.attributes['reason']}" if result.attributes["reason"] else ""
    print(f"{cell}: {result.attributes['status']}{reason}; {how}")


def cell_path(study: Study, name: str) -> Path:
    return study.results_folder / "cells" / f"{name}.h5"


def truth_folder(study: Study) -> Path:
    """Return where the cells of the study's virtual sensor lie."""
    return study.data_folder / "virtual_truth" / "cells"


def feature_path(study: Study, session: str) -> Path:
    return study.results_folder / "features" / f"{session}.h5"


def shard_paths(study: Study) -> list[Path]:
    """Return the files of every shard of the plan, in order."""
    from gelforge.indentation.planning.plan import plan_cells

    count = -(-len(plan_cells(study)) // study.dataset.cells_per_shard)
    return [study.results_folder / "dataset" / f"shard-{i:05d}.h5" for i in range(count)]


def session_of(study: Study, name: str):
    """Return the description of one of the study's sessions."""
    from gelforge.config import load_session

    return load_session(study.session_folder(name) / "session.yaml")


def image_sessions(study: Study) -> list[str]:
    """Return the sessions that have a camera; the others measure force only."""
    return [name for name in study.sessions if session_of(study, name).camera is not None]


def agreement_inputs(study: Study, laws: dict) -> tuple[dict, dict]:
    """Return what the digests of the study's cells and of its sessions' tables are under its present settings and laws."""
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.inputs import inputs_digest
    from gelforge.recording.readings import raw_digest

    cells = {name: inputs_digest(study, laws, cell) for name, cell in plan_cells(study).items()}
    return cells, {name: raw_digest(study.session_folder(name)) for name in study.sessions}


def session_presses(study: Study, session: str) -> list:
    """Return the presses of a session in the order recorded, from its readings."""
    from gelforge.dataset.recorded_presses import recorded_presses
    from gelforge.files import check_table_inputs
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.recording.readings import raw_digest, read_readings

    path = study.results_folder / "recordings" / f"{session}.csv"
    remedy = f"make the readings again (snakemake -R {path})"
    check_table_inputs(path, raw_digest(study.session_folder(session)), remedy)
    return recorded_presses(read_readings(path), plan_cells(study), study)


def own_labels(study: Study, cells: dict, laws: dict | None = None) -> dict:
    """Return by session where labels that are its own are; with laws also what their digests must be."""
    from gelforge.dataset.recorded_presses import presses_digest
    from gelforge.dataset.session_labels import OwnCells, OwnPresses
    from gelforge.indentation.solving.inputs import inputs_digest

    found: dict[str, OwnPresses | OwnCells] = {}
    for name in study.sessions:
        own = session_study(study, session_of(study, name))
        folder = study.results_folder / "sessions" / name
        if study.mechanics.effects.history.softens:
            digest = presses_digest(own, laws, session_presses(own, name)) if laws else None
            found[name] = OwnPresses(folder / "presses.h5", digest)
        elif own is not study:
            files = {cell: folder / "cells" / f"{cell}.h5" for cell in cells}
            solved = {cell: replace(planned, between="") for cell, planned in cells.items()}
            digests = {cell: inputs_digest(own, laws, solved[cell]) for cell in cells} if laws else {}
            found[name] = OwnCells(files, digests)
    return found


def virtual_lab_of(study: Study, path: Path):
    """Return the study's virtual lab, or say that it has none."""
    if study.virtual_lab is None:
        raise ConfigError(f"{path}: the study has no virtual_lab; name its YAML file to make synthetic data")
    lab = load_virtual_lab(study.virtual_lab)
    if study.mirrors_cells and not lab.mechanics.effects.has_symmetry_of_square:
        raise ConfigError(
            f"{study.virtual_lab}: its mechanics.effects have a place, a direction or an order, but {path} mirrors cells"
            f" (plan.symmetry: {study.plan.symmetry}); use symmetry: none"
        )
    return lab


def solved_between(study: Study, name: str):
    """Return a site between which labels of the plan are interpolated."""
    from gelforge.cli.between import between_site
    from gelforge.indentation.planning.plan import plan_cells

    return between_site(study, plan_cells(study), name)


def planned_cell(study: Study, name: str):
    """Return a cell of the plan by name."""
    from gelforge.indentation.planning.plan import plan_cells

    cells = plan_cells(study)
    if name not in cells:
        raise ConfigError(
            f"cell {name!r} is not in the plan of study {study.study}; its {len(cells)} cells begin with "
            f"{', '.join(list(cells)[:3])}"
        )
    return cells[name]


def read_laws(study: Study) -> dict:
    """Return the study's laws [MPa] by material."""
    return {law.material: law.law for law in own_laws(study)}


def own_laws(study: Study) -> list:
    """Return the study's laws with what is known of them, in the order of its materials."""
    return [study_law(study, law_path(study, material), material) for material in study.materials]


def study_laws(study: Study, paths: list[Path]) -> dict:
    """Return by material the laws of files, with what is known of them; each layer's material must be among them."""
    from gelforge.materials.fitting.law_file import LawFileError

    read = {law.material: law for law in (study_law(study, path) for path in paths)}
    missing = sorted({layer.material for layer in study.sensor.layers} - read.keys())
    if missing:
        raise LawFileError(
            f"{', '.join(map(str, paths))}: no constitutive model of {missing} among those of {sorted(read)}; run"
            " the material stage again"
        )
    return read


def study_law(study: Study, path: Path, material: str | None = None):
    """Return a law after checking that it is that of a material (None: of any) of this study, made for no other study."""
    from gelforge.materials.fitting.law_file import LawFileError, read_law

    law = read_law(path)
    if law.material not in ([material] if material else study.materials) or law.study not in (
        "",
        study.study,
    ):
        raise LawFileError(
            f"{path}: the constitutive model of {law.material!r} of study {law.study!r}, expected"
            f" {material or sorted(study.materials)}"
            f" of study {study.study!r}; run the material stage again (snakemake -R {path})"
        )
    return law


def print_findings(recording) -> None:
    """Print what the tests of a session found, a line per test."""
    for level, word in (("excluded", "excluded"), ("note", "note")):
        for line in recording.findings.lines(level):
            print(f"{word:<10} {recording.session.session}: {line}")


def recording_of(study: Study, session: str):
    """Return a session of the study, checked and joined to the plan."""
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.recording.readings import read_recording

    return read_recording(study.session_folder(session), plan_cells(study), study.sensor)
