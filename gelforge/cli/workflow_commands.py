"""The table of the commands that the workflow runs, as commands.py has those of people: each needs a study."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.shared_arguments import (
    FOLDER,
    HDF5,
    Argument,
    Command,
    arg,
    command,
    flag,
    laws,
    need,
    study,
    written,
)

CELL = need("--cell", "name of the cell in the plan")
SESSION = need("--session", "name of the session")
LAWS = laws(nargs="+", required=True)
FRESH = flag("--fresh", "solve anew what an earlier job that was broken off has solved from the same inputs")
TRAINED = need("--model", "model.pt as trained", Path)


def job(run: str, text: str, *arguments: Argument) -> Command:
    return command(run, text, study(required=True), *arguments)


COMMANDS = {
    # --- what the workflow runs: labels
    "fit-law": job(
        "jobs.materials.fit_law",
        "material tests, or parameters, to a constitutive model and measured effects",
        need("--material", "name of the material in the study"),
        FOLDER,
    ),
    "plan": job("jobs.sites.plan", "the study's cells as a table", written("CSV")),
    "simulate": job(
        "jobs.sites.simulate",
        "one cell of a study",
        CELL,
        LAWS,
        flag(
            "--between",
            "the cell is one of the sites between which labels are interpolated (plan.interpolation)",
        ),
        arg("--variant", "solve the cell as this variant of the study has it"),
        arg("--session", "solve the cell at the age and temperature that this session states"),
        written("the cell's HDF5 file"),
        FRESH,
    ),
    "level": job(
        "jobs.interpolation.level",
        "which sites are solved after a level (plan.interpolation)",
        need("--level", "number of the level, from 0", int),
        LAWS,
        written("JSON"),
    ),
    "derive": job(
        "jobs.interpolation.derive",
        "a job's mirrored and interpolated cells, written next to the solved ones",
        need("--number", "number of the job, from 0", int),
        LAWS,
    ),
    "sensitivities": job(
        "jobs.sensitivities.sensitivities",
        "the derivatives of one site's forces along all that a verdict may ask for",
        CELL,
        LAWS,
        HDF5,
    ),
    "simulate-session": job(
        "jobs.sites.simulate_session",
        "a session's indentations in recorded order on a sensor that softens; goes on where it was broken off",
        SESSION,
        LAWS,
        HDF5,
        FRESH,
    ),
    "readings": job(
        "jobs.recordings.readings",
        "a session's forces on the sensor, zero subtracted",
        SESSION,
        written("CSV"),
    ),
    "features": job(
        "jobs.recordings.features",
        "optical-flow features of a session's images",
        SESSION,
        HDF5,
        arg("--workers", "threads that read and reduce images", int, default=1),
    ),
    "join": job(
        "jobs.dataset.join",
        "one shard of the dataset",
        need("--shard", "number of the shard", int),
        written("the shard's HDF5 file"),
    ),
    "manifest": job("jobs.dataset.manifest", "checksums, provenance and card of the dataset"),
    "agreement": job(
        "jobs.dataset.agreement", "simulated and measured total force, per indentation", written("CSV")
    ),
    "solve-synthesis": job(
        "jobs.synthesis.solve",
        "one of the presses that synthetic training rows come from",
        need("--number", "number of the press, from 0: sites, then paths", int),
        LAWS,
        HDF5,
    ),
    "synthesise": job(
        "jobs.synthesis.synthesise",
        "SYNTHETIC training rows, drawn from solved presses",
        need("--number", "number of the shard, from 0", int),
        need("--solved", "every solved press, in order", Path, nargs="+"),
        HDF5,
    ),
    # --- what the workflow runs: the network
    "train": job(
        "model.learning.train",
        "train the network; goes on from its last checkpoint",
        need("--model", "model.pt to write", Path),
        need("--loss", "loss.csv to write", Path),
    ),
    "adapt": job(
        "model.learning.adapt",
        "gains of a model for another sensor, from a few indentations with measured forces",
        TRAINED,
        arg("--presses", "recorded indentations to fit, drawn from those that train", int, default=20),
        arg("--seed", "seed of the draw", int, default=0),
        written("model.pt"),
    ),
    "evaluate": job(
        "model.learning.evaluate", "predict the held-out cells", TRAINED, written("HDF5 file of predictions")
    ),
    "onnx-check": job(
        "model.export.onnx_check",
        "forces of held-out images by ONNX Runtime against PyTorch's predictions",
        need("--model", "model.onnx as exported", Path),
        written("JSON"),
    ),
    # --- what the workflow runs: results, synthetic data
    "tables": job("jobs.results.tables", "the article's tables from saved predictions"),
    "report": job("jobs.results.report", "the study's offline page", written("HTML page")),
    "virtual-materials": job(
        "jobs.virtual_lab.virtual_materials",
        "SYNTHETIC raw material tests of a virtual lab",
        arg("--material", "one material; all of the virtual lab if not given"),
    ),
    "virtual-cell": job(
        "jobs.virtual_lab.virtual_cell",
        "one cell of the virtual sensor's truth",
        CELL,
        written("the cell's HDF5 file"),
        FRESH,
    ),
    "virtual-session": job(
        "jobs.virtual_lab.virtual_session",
        "one SYNTHETIC session of a virtual lab",
        need("--session", "name of the session in the virtual lab"),
        arg("--workers", "threads that draw images", int, default=1),
    ),
}
