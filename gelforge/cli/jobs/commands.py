"""Arguments of the jobs that the workflow runs; those of the network are in gelforge/cli/model."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.common import FRESH, add_laws, study_command


def add_labels(commands) -> None:
    """Add what leads from material tests and recordings to the dataset."""
    law = study_command(
        commands,
        "fit-law",
        "jobs.materials.fit_law",
        "material tests, or parameters, to a constitutive model and measured effects",
    )
    law.add_argument("--material", required=True, help="name of the material in the study")
    law.add_argument("--out", type=Path, required=True, help="folder to write")

    plan = study_command(commands, "plan", "jobs.sites.plan", "the study's cells as a table")
    plan.add_argument("--out", type=Path, required=True, help="CSV to write")

    simulate = study_command(commands, "simulate", "jobs.sites.simulate", "one cell of a study")
    simulate.add_argument("--cell", required=True, help="name of the cell in the plan")
    add_laws(simulate, nargs="+", required=True)
    simulate.add_argument(
        "--mirrored", type=Path, nargs="*", default=[], metavar="H5", help="cell that this one mirrors"
    )
    simulate.add_argument(
        "--between",
        action="store_true",
        help="the cell is one of the sites between which labels are interpolated (plan.interpolation)",
    )
    simulate.add_argument("--variant", help="solve the cell as this variant of the study has it")
    simulate.add_argument(
        "--session", help="solve the cell at the age and temperature that this session states"
    )
    simulate.add_argument("--out", type=Path, required=True, help="the cell's HDF5 file to write")
    simulate.add_argument("--fresh", action="store_true", help=FRESH)

    level = study_command(
        commands,
        "level",
        "jobs.interpolation.level",
        "which sites are solved after a level (plan.interpolation)",
    )
    level.add_argument("--level", type=int, required=True, help="number of the level, from 0")
    add_laws(level, nargs="+", required=True)
    level.add_argument("--out", type=Path, required=True, help="JSON to write")

    derive = study_command(
        commands,
        "derive",
        "jobs.interpolation.derive",
        "a job's mirrored and interpolated cells, written next to the solved ones",
    )
    derive.add_argument("--number", type=int, required=True, help="number of the job, from 0")
    add_laws(derive, nargs="+", required=True)

    slopes = study_command(
        commands,
        "sensitivities",
        "jobs.sensitivities.sensitivities",
        "the derivatives of one site's forces along all that a verdict may ask for",
    )
    slopes.add_argument("--cell", required=True, help="name of the cell in the plan")
    add_laws(slopes, nargs="+", required=True)
    slopes.add_argument("--out", type=Path, required=True, help="HDF5 file to write")

    in_order = study_command(
        commands,
        "simulate-session",
        "jobs.sites.simulate_session",
        "a session's indentations in recorded order on a sensor that softens; goes on where it was broken off",
    )
    in_order.add_argument("--session", required=True, help="name of the session")
    add_laws(in_order, nargs="+", required=True)
    in_order.add_argument("--out", type=Path, required=True, help="HDF5 file to write")
    in_order.add_argument("--fresh", action="store_true", help=FRESH)

    for name, text in (
        ("readings", "a session's forces on the sensor, zero subtracted"),
        ("features", "optical-flow features of a session's images"),
    ):
        command = study_command(commands, name, f"jobs.recordings.{name}", text)
        command.add_argument("--session", required=True, help="name of the session")
        command.add_argument("--out", type=Path, required=True, help="CSV to write, of features HDF5")
        if name == "features":
            command.add_argument("--workers", type=int, default=1, help="threads that read and reduce images")

    join = study_command(commands, "join", "jobs.dataset.join", "one shard of the dataset")
    join.add_argument("--shard", type=int, required=True, help="number of the shard")
    join.add_argument("--out", type=Path, required=True, help="the shard's HDF5 file to write")

    study_command(
        commands, "manifest", "jobs.dataset.manifest", "checksums, provenance and card of the dataset"
    )

    agreement = study_command(
        commands,
        "agreement",
        "jobs.dataset.agreement",
        "simulated and measured total force, per indentation",
    )
    agreement.add_argument("--out", type=Path, required=True, help="CSV to write")

    solve = study_command(
        commands,
        "solve-synthesis",
        "jobs.synthesis.solve",
        "one of the presses that synthetic training rows come from",
    )
    solve.add_argument(
        "--number", type=int, required=True, help="number of the press, from 0: sites, then paths"
    )
    add_laws(solve, nargs="+", required=True)
    solve.add_argument("--out", type=Path, required=True, help="HDF5 file to write")

    synthesise = study_command(
        commands,
        "synthesise",
        "jobs.synthesis.synthesise",
        "SYNTHETIC training rows, drawn from solved presses",
    )
    synthesise.add_argument("--number", type=int, required=True, help="number of the shard, from 0")
    synthesise.add_argument(
        "--solved", type=Path, nargs="+", required=True, help="every solved press, in order"
    )
    synthesise.add_argument("--out", type=Path, required=True, help="HDF5 file to write")


def add_results(commands) -> None:
    """Add what a finished study is shown by."""
    study_command(commands, "tables", "jobs.results.tables", "the article's tables from saved predictions")

    report = study_command(commands, "report", "jobs.results.report", "the study's offline page")
    report.add_argument("--out", type=Path, required=True, help="HTML page to write")


def add_virtual_lab(commands) -> None:
    """Add what makes SYNTHETIC data."""
    materials = study_command(
        commands,
        "virtual-materials",
        "jobs.virtual_lab.virtual_materials",
        "SYNTHETIC raw material tests of a virtual lab",
    )
    materials.add_argument("--material", help="one material; all of the virtual lab if not given")

    cell = study_command(
        commands, "virtual-cell", "jobs.virtual_lab.virtual_cell", "one cell of the virtual sensor's truth"
    )
    cell.add_argument("--cell", required=True, help="name of the cell in the plan")
    cell.add_argument("--out", type=Path, required=True, help="the cell's HDF5 file to write")
    cell.add_argument("--fresh", action="store_true", help=FRESH)

    session = study_command(
        commands,
        "virtual-session",
        "jobs.virtual_lab.virtual_session",
        "one SYNTHETIC session of a virtual lab",
    )
    session.add_argument("--session", required=True, help="name of the session in the virtual lab")
    session.add_argument("--workers", type=int, default=1, help="threads that draw images")
