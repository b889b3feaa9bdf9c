"""Jobs of labels that are made from others: which sites are solved for them, and mirrored and interpolated cells."""

from __future__ import annotations

from dataclasses import asdict
from functools import cache
from pathlib import Path

from gelforge.cli.products import cell_path, print_outcome, site_path, study_laws
from gelforge.config import ConfigError, Study, given, load_study
from gelforge.progress import tracked


def level(study: Path, level: int, laws: list[Path], out: Path) -> None:
    """Write which sites are solved after a level, as JSON, and say how far the labels then are from the tolerance."""
    from gelforge.files import write_product_json
    from gelforge.indentation.planning.lattice import lattice_of
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.interpolation.levels import decide, first_level

    described = load_study(study)
    cells = plan_cells(described)
    lattice = lattice_of(described, cells) if any(cell.between for cell in cells.values()) else None
    if lattice is None:
        raise ConfigError(f"{study}: no label of the plan is interpolated; give plan.interpolation")
    names = first_level(lattice)
    if level:
        before = read_decision(out.with_name(f"level_{level - 1}.json"))
        names = before["solved"] + before["more"]
    solved = solved_sites(described, cells, names, study_laws(described, laws))
    planned = [cell for cell in cells.values() if cell.between and cell.source is None]
    interpolation = given(described.plan.interpolation, "plan.interpolation")
    decided = decide(solved, level, planned, interpolation)
    forget_later(described, cells, level, out)
    write_product_json(out, asdict(decided) | {"tolerance": interpolation.model_dump(mode="json")})
    print(decided.words)


def forget_later(study: Study, cells: dict, level: int, out: Path) -> None:
    """Remove what an earlier decision of a level led to: decisions of later levels and interpolated cells.

    Snakemake asks for no further level, nor for the cells, as long as cells of an earlier decision are there.
    """
    later = [path for path in out.parent.glob("level_*.json") if int(path.stem.rpartition("_")[2]) > level]
    for path in [*later, *(cell_path(study, name) for name, cell in cells.items() if cell.between)]:
        path.unlink(missing_ok=True)


def derive(study: Path, number: int, laws: list[Path]) -> None:
    """Write the mirrored and interpolated cells of one job, each from the sites that it names."""
    from gelforge.indentation.cells.cell_file import write_cell
    from gelforge.indentation.planning.derived import derived_chunks
    from gelforge.indentation.planning.plan import plan_cells
    from gelforge.indentation.solving.mirror import mirror_cell

    described = load_study(study)
    cells = plan_cells(described)
    chunks = derived_chunks(cells, described.dataset.cells_per_shard)
    if number not in chunks:
        raise ConfigError(
            f"{study}: no job {number} makes mirrored or interpolated cells; there are {sorted(chunks)}"
        )
    read = study_laws(described, laws)
    by_material = {name: law.law for name, law in read.items()}
    interpolates = any(cells[name].between for name in chunks[number])
    labels = labels_of(described, cells, read) if interpolates else None

    @cache
    def made(name: str):
        planned = cells[name]
        if planned.source:
            return mirror_cell(made(planned.source), described, by_material, planned)
        if not planned.between:
            return checked_cell(described, planned, by_material)
        assert labels is not None  # read where one of the job's sites is between others
        return labels.cell(planned)

    for name in tracked(chunks[number], "mirrored and interpolated sites"):
        write_cell(cell_path(described, name), made(name))
        print_outcome(name, made(name), words_of(made(name)))


def words_of(cell) -> str:
    """Return how a derived cell was made."""
    if cell.attributes["source"]:
        return f"mirrored from {cell.attributes['source']}"
    if "solved_as" in cell.attributes:
        return f"solved as {cell.attributes['solved_as']}"
    return f"interpolated between {len(cell.attributes['interpolated_from'])} solved sites"


def labels_of(study: Study, cells: dict, read: dict):
    """Return what the interpolated labels of a study are made from, after the last level was decided."""
    from gelforge.interpolation.labels import Labels

    folder, number = study.results_folder / "interpolation", 0
    while (decided := read_decision(folder / f"level_{number}.json"))["more"]:
        number += 1
    solved = solved_sites(study, cells, decided["solved"], read)
    laws = {name: law.law for name, law in read.items()}
    themselves = {name: solved_cell(study, cells, name, laws) for name in decided["themselves"]}
    return Labels(study, laws, solved, themselves)


def solved_sites(study: Study, cells: dict, names: list[str], read: dict):
    """Return the named solved sites of a study's lattice, each checked against the present settings and laws."""
    from gelforge.indentation.planning.lattice import index_of, lattice_of
    from gelforge.interpolation.solved_sites import SolvedSites

    lattice = given(lattice_of(study, cells), "plan.interpolation")
    laws = {name: law.law for name, law in read.items()}
    solved = {}
    for name in names:
        at = index_of(name)
        assert at is not None  # names are those of the lattice's places
        solved[at] = solved_cell(study, cells, name, laws)
    others = any(cell.between and cell.depths_mm != lattice.depths_mm for cell in cells.values())
    return SolvedSites(lattice, study.sensor, study.indenter, solved, others)


def solved_cell(study: Study, cells: dict, name: str, laws: dict):
    """Return a solved site of the lattice, or one of the plan that is solved itself for the others' sake."""
    return checked_cell(study, between_site(study, cells, name), laws, site_path(study, name))


def between_site(study: Study, cells: dict, name: str):
    """Return the site that is solved under a name: a place of the lattice, or one of the plan by itself."""
    from dataclasses import replace

    from gelforge.indentation.planning.lattice import lattice_of, solved_site

    lattice = lattice_of(study, cells) if study.plan.interpolation else None
    site = solved_site(lattice, name) if lattice else None
    if site is None and name not in cells:
        raise ConfigError(
            f"{name!r} is neither a site of the plan nor one between which its labels are interpolated"
        )
    return site or replace(cells[name], source=None, symmetry=None, between="")


def checked_cell(study: Study, planned, laws: dict, path: Path | None = None):
    """Return a solved cell after checking that it is the planned one under the present settings."""
    from gelforge.dataset.session_labels import check_digest
    from gelforge.indentation.cells.cell_file import read_cell
    from gelforge.indentation.solving.inputs import inputs_digest

    path = path or cell_path(study, planned.name)
    cell = read_cell(path)
    check_digest(path, planned.name, cell, inputs_digest(study, laws, planned))
    return cell


def read_decision(path: Path) -> dict:
    """Return what a level decided. Raises ConfigError for a file that is missing or not one."""
    from gelforge.files import read_product_json

    decision = read_product_json(path, f"decide again (snakemake -R {path})", ConfigError)
    if not {"solved", "more", "themselves"} <= set(decision):
        raise ConfigError(f"{path}: not a level's decision; decide again (snakemake -R {path})")
    return decision
