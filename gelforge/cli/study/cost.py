"""What a study costs before it runs: minutes of finite elements, from measured cells, of images and training, and disk.

Jobs of a cluster ask for their time by the same numbers (workflow/rules/cluster.smk).
cell_cost.csv holds the measurements; `python benchmarks/cell_cost.py --update` makes it anew.
"""

from __future__ import annotations

import math
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from gelforge.cli.study.mesh_quality import mesh_error_words
from gelforge.config import (
    Camera,
    Mesh,
    Study,
    VirtualLab,
    given,
    load_session,
    load_virtual_lab,
    session_study,
    variant_study,
)
from gelforge.dataset.schema import columns
from gelforge.indentation.planning.derived import derived_chunks
from gelforge.progress import duration

if TYPE_CHECKING:
    import pandas as pd

MEASURED = Path(__file__).with_name("cell_cost.csv")
DEPTHS = 8  # of every measured cell

# Estimates of `gelforge check`, on which no result depends; the tables in results/<study>/benchmarks hold what a run
# took:
# A press on a sensor that softens, coarse-mesh solution included, measured on the article's sensor with 5556 degrees of
# freedom: a step takes 1.6 times that of a plain cell, and what is left behind 3.2 s on 0.44 million points of both grids.
SOFTENING_STEP, GRID_POINT_S = 1.6, 7e-6
# Seconds, estimated; results/<study>/benchmarks/ has what a run took: a label between solved sites, with what decides which
# they are; a job beyond its cells, a fork of a process that has loaded everything; a process of its own with its compiled
# kernels; a training row, drawn as indentation, image and flow.
INTERPOLATED_S, JOB_S, START_S, ROW_S = 0.1, 0.6, 3.0, 0.05
SECOND_LEVEL = 1  # where an interpolated plan usually ends: one halving of the first spacing
SENSITIVITIES = 1.3  # of a site with its error bars: all derivatives (benchmarks/sensitivity_cost.py)
# The same (results/<study>/benchmarks/) of a material's fits, all checks of the finite elements, the page; a model as ONNX,
# images of held-out sites by ONNX Runtime.
FIT_S, VERIFY_S, REPORT_S, EXPORT_S, ONNX_CHECK_S = 5.0, 40.0, 10.0, 10.0, 5.0
WITHOUT_BARS = 0.8  # of a cell with error bars, which cost a second solution on a mesh of twice the sizes
# A verdict in cells of the study's mesh per position that is judged: 1 in the demo, up to five times as many where no effect
# fits (benchmarks/mismatch_cost.py). Images took 6 more in the benchmark study's verdict. It begins with reading, its
# libraries and its page.
VERDICT_CELLS, VERDICT_IMAGE_CELLS, VERDICT_START = 1.5, 6, 20.0
# CPU seconds, measured on the test study: 4.0 and 2.7 for 45 and 36 images of 0.16 megapixels, 3.9 for 45 that are drawn,
# start included.
FEATURES_S_PER_MPX, DRAWING_S_PER_MPX = 0.5, 0.5
# CPU seconds a row of a batch on one thread, measured: 1.1e-3 of the U-Net with 40 regions and 20 bins a side (the demo),
# 0.7e-3 of the article's network.
TRAINING_S_PER_ROW = 1.1e-3
EVALUATION_S_PER_MB = 2.0  # of the shards: baselines are fitted and asked too


class Costs:
    """CPU seconds of a study's jobs; a mesh is made when the first of its jobs is asked for."""

    def __init__(self, study: Study, cells: dict):
        self.study, self.cells = study, cells
        self.measured = read_costs()
        mirrored = self.measured["kind"] == "mirrored"  # by a job that makes many
        self.mirrored = float(self.measured.loc[mirrored, "cpu_s"].median())
        self.first = next(cell for cell in cells.values() if cell.source is None)

    @cached_property
    def mesh(self) -> tuple[int, int]:
        """Unknowns and surface nodes of the study's mesh."""
        return mesh_size(self.study, self.study.mechanics.mesh, self.first)

    @cached_property
    def solved(self) -> float:
        """A solved cell with DEPTHS depths."""
        return cell_seconds(self.measured, self.mesh[0])

    @cached_property
    def _truth(self) -> tuple[float, int]:
        lab = load_virtual_lab(given(self.study.virtual_lab, "virtual_lab"))
        unknowns, _ = mesh_size(self.study, lab.mechanics.mesh, self.first)
        return cell_seconds(self.measured, unknowns), len(lab.unload_depths_mm)

    def cell(self, cell) -> float:
        """A planned cell, solved, mirrored or interpolated, without the job that makes it and others."""
        if cell.solved:
            return self.solved * len(cell.depths_mm) / DEPTHS
        return self.mirrored if cell.source else INTERPOLATED_S

    def cells_of_plan(self) -> float:
        """All cells of the plan: a job for each that is solved, some for all others."""
        jobs = sum(cell.solved for cell in self.cells.values())
        jobs += len(derived_chunks(self.cells, self.study.dataset.cells_per_shard))
        return JOB_S * jobs + sum(map(self.cell, self.cells.values()))

    def true_cell(self, cell) -> float:
        """A cell of the virtual sensor, which is loaded and unloaded."""
        seconds, unloading = self._truth
        return seconds * (len(cell.depths_mm) + unloading) / DEPTHS

    def synthesis_press(self) -> float:
        """One solved press of the simulated training set; a path has about as many steps again as it loads in."""
        steps = 2 * given(self.study.synthesis, "synthesis").steps
        return JOB_S + WITHOUT_BARS * self.solved * steps / DEPTHS

    def synthesis_rows(self, rows: int) -> float:
        """Drawn training rows."""
        return START_S + ROW_S * rows

    def synthesis(self) -> float:
        """The whole simulated training set."""
        from gelforge.synthesis.draws import solution_count

        rows = given(self.study.synthesis, "synthesis").rows
        return solution_count(self.study) * self.synthesis_press() + self.synthesis_rows(rows)

    def variant(self, name: str, cell) -> float:
        """A cell of a variant."""
        varied = variant_study(self.study, name)
        unknowns, _ = mesh_size(varied, varied.mechanics.mesh, cell)
        return cell_seconds(self.measured, unknowns) * len(cell.depths_mm) / DEPTHS

    def session_presses(self, session: str) -> float:
        """A session's presses, followed in order step by step."""
        presses, steps = steps_in_order(self.study, self.cells, session)
        return (
            SOFTENING_STEP * self.solved * steps / DEPTHS + presses * grid_points(self.study) * GRID_POINT_S
        )

    def images(self, session: str) -> tuple[int, float]:
        """The number of a session's images and the megapixels of each; none without a camera, or where it is not there."""
        if self.study.virtual_lab:
            lab = load_virtual_lab(self.study.virtual_lab)
            return drawn_images(lab, self.cells, session), megapixels(lab.camera)
        folder = self.study.session_folder(session)
        if not ((folder / "session.yaml").is_file() and (folder / "images").is_dir()):
            return 0, 0.0
        camera = load_session(folder / "session.yaml").camera
        count = sum(1 for _ in (folder / "images").iterdir())
        return (count, megapixels(camera)) if camera else (0, 0.0)

    def features(self, session: str) -> float:
        """The features of a session's images; threads share it."""
        return FEATURES_S_PER_MPX * math.prod(self.images(session))

    def drawing(self, session: str) -> float:
        """The images of a synthetic session; threads share it."""
        return DRAWING_S_PER_MPX * math.prod(self.images(session))

    def learning_mb(self) -> float:
        """Megabytes of the rows that the network learns from or is asked, recorded and simulated."""
        study, rows = self.study, sum(self.images(session)[0] for session in self.study.sessions)
        if study.synthesis:
            rows += study.synthesis.rows
        return rows * row_bytes(study) / 1e6

    def training(self) -> float:
        """Training, whatever the number of rows; wall seconds, also on more than one core."""
        learning = self.study.learning.usual
        return TRAINING_S_PER_ROW * learning.steps * learning.batch_size

    def evaluation(self, size_mb: float) -> float:
        """Predictions of the held-out rows of shards of this size, and baselines; wall seconds."""
        return EVALUATION_S_PER_MB * size_mb

    def mismatch(self) -> float:
        """A verdict on all sessions together; positions that are mirror images of one another are solved once."""
        unmirrored = sum(cell.source is None for cell in self.cells.values()) / len(self.cells)
        positions = math.ceil(unmirrored * min(self.study.mismatch.sites, len(self.cells)))
        per_position = VERDICT_CELLS
        if self.study.mismatch.images in ("fitted", "predicted") and any(
            self.images(one)[0] for one in self.study.sessions
        ):
            per_position += VERDICT_IMAGE_CELLS
        return VERDICT_START + per_position * positions * self.cell(self.first)

    def of_rules(self) -> dict[str, float]:
        """Core seconds of one job of each rule, for the time left of a run; rules that read and write are left out."""
        study, sessions = self.study, self.study.sessions
        site = JOB_S + self.cell(self.first)
        rows = self.learning_mb()
        seconds = dict.fromkeys(("simulate", "solve_site", "session_cell", "variant"), site)
        seconds |= {"characterise": FIT_S, "verify": VERIFY_S, "report": REPORT_S, "train": self.training()}
        seconds |= {"evaluate": self.evaluation(rows), "export": EXPORT_S, "onnx_check": ONNX_CHECK_S}
        seconds |= {"site_sensitivities": JOB_S + SENSITIVITIES * site}
        if study.virtual_lab:
            seconds["virtual_cell"] = JOB_S + self.true_cell(self.first)
            seconds["virtual_session"] = sum(map(self.drawing, sessions)) / max(len(sessions), 1)
        if study.synthesis:
            seconds["solve_synthesis"] = self.synthesis_press()
            seconds["synthesise"] = self.synthesis_rows(study.synthesis.rows_per_shard)
        if sessions:
            seconds["features"] = sum(map(self.features, sessions)) / len(sessions)
            seconds["mismatch"] = self.mismatch()
        return seconds


def estimate(study: Study, cells: dict) -> list[str]:
    """Return lines with a study's number of cells, minutes of finite elements, images and training, and disk."""
    from gelforge.indentation.planning.plan import variant_cells

    costs = Costs(study, cells)
    solved = [cell for cell in cells.values() if cell.solved]
    mirrored = sum(cell.source is not None for cell in cells.values())
    between = len(cells) - len(solved) - mirrored
    presses = sum(len(cell.depths_mm) for cell in cells.values())
    seconds = costs.cells_of_plan()
    if study.stores_sensitivities:
        seconds += sum(JOB_S + SENSITIVITIES * costs.cell(cell) for cell in cells.values() if cell.solved)
    if study.virtual_lab:
        seconds += sum(JOB_S + costs.true_cell(cell) for cell in cells.values() if cell.source is None)
    if between:
        some, words = interpolation_cost(costs)
        seconds += some
    for name in study.variants:
        seconds += sum(
            JOB_S + costs.variant(name, cell) for cell in variant_cells(cells, study, name).values()
        )
    if study.synthesis:
        seconds += costs.synthesis()
    of_sessions, lines = session_costs(costs)
    seconds += of_sessions
    unknowns, surface = costs.mesh
    # float64 forces (two of three components each) and float32 displacement on surface nodes, three sets of bins
    bins = study.sensor.bins.nx * study.sensor.bins.ny
    disk = presses * (surface * (2 * 3 * 8 + 3 * 4 + 1) + bins * 3 * 3 * 8)
    judged = [
        f"verdict    about {duration(costs.mismatch() / 2)} on two cores, up to five times where no effect fits"
    ]
    return [
        f"cells      {len(cells)} positions, {presses} presses; {len(solved)} solved, {mirrored} mirrored"
        + (f", {between} interpolated" if between else ""),
        *([words] if between else []),
        *lines,
        f"mesh       {study.mechanics.mesh.quality}, {unknowns} degrees of freedom at ({costs.first.x_mm:g}, "
        f"{costs.first.y_mm:g}) mm; about {costs.cell(costs.first):.2g} CPU s there; {mesh_error_words(study)}",
        time_line(costs, seconds),
        *(judged if study.judges else []),
        f"disk       at most {disk / 1e6:.1f} MB for the cells (before compression)",
    ]


def time_line(costs: Costs, finite_elements: float) -> str:
    """Return the line about the time on two cores and its parts; finite_elements: their CPU seconds."""
    study, parts = costs.study, {"finite elements": finite_elements / 2}
    images = sum(map(costs.features, study.sessions))
    images += sum(map(costs.drawing, study.sessions)) if study.virtual_lab else 0.0
    size_mb = costs.learning_mb()
    if images:
        parts["images"] = images / 2
    if size_mb:
        parts["training and prediction"] = costs.training() + costs.evaluation(size_mb)
    words = ", ".join(f"{what} {duration(seconds)}" for what, seconds in parts.items())
    return f"time       about {duration(sum(parts.values()))} on two cores (estimate): {words}"


def interpolation_cost(costs: Costs) -> tuple[float, str]:
    """Return the CPU seconds of the sites between which labels are interpolated, if two levels do, and a line about them."""
    from gelforge.indentation.planning.lattice import lattice_of

    lattice = given(lattice_of(costs.study, costs.cells), "plan.interpolation")
    first, second = (len(lattice.representatives(lattice.level(n))) for n in (0, SECOND_LEVEL))
    words = f"between    {first} sites {lattice.spacing_mm:.3g} mm apart are solved and as many more as the tolerance needs"
    words += f" ({second} at half the spacing); {len(lattice.depths_mm)} depths each"
    return second * (JOB_S + costs.solved * len(lattice.depths_mm) / DEPTHS), words


def session_costs(costs: Costs) -> tuple[float, list[str]]:
    """Return the CPU seconds of labels that belong to sessions, and a line for each session that is there."""
    from gelforge.dataset.recorded_presses import pressed_cells

    study, cells = costs.study, costs.cells
    total, lines = 0.0, []
    for name in study.sessions:
        folder = study.session_folder(name)
        if study.mechanics.effects.history.softens:
            presses, _ = steps_in_order(study, cells, name)
            seconds = costs.session_presses(name)
            what = f"{presses} presses followed in order, one job on one core, about {duration(seconds)}"
        elif not study.virtual_lab and (folder / "indentations.csv").is_file():
            if session_study(study, load_session(folder / "session.yaml")) is study:
                continue
            needed = [cells[cell] for cell in pressed_cells(folder, cells)]
            seconds = sum(JOB_S + costs.cell(cell) for cell in needed)  # each has a job of its own
            solved = sum(cell.source is None for cell in needed)
            what = f"{len(needed)} cells at its own age and temperature, {solved} solved"
        else:
            continue
        lines.append(f"session    {name}: {what}")
        total += seconds
    return total, lines


def steps_in_order(study: Study, cells: dict, session: str) -> tuple[int, int]:
    """Return the number of a session's presses and of the steps in which they are followed; none where it is not there."""
    from gelforge.dataset.recorded_presses import read_presses, recorded_presses
    from gelforge.indentation.effects.history import in_time
    from gelforge.indentation.paths.trajectory import Trajectory
    from gelforge.virtual_lab.session import session_cells

    if study.virtual_lab:
        pressed = session_cells(load_virtual_lab(study.virtual_lab), cells)[session]
        paths = [Trajectory(0, 0, (depth,), ("load",)) for name in pressed for depth in cells[name].depths_mm]
    elif (study.session_folder(session) / "indentations.csv").is_file():
        readings = read_presses(study.session_folder(session), cells)
        paths = [press.path for press in recorded_presses(readings, cells, study)]
    else:
        paths = []
    timing = study.mechanics.effects.history.timing
    return len(paths), sum(len(in_time(path, timing).trajectory.depths_mm) for path in paths)


def drawn_images(lab: VirtualLab, cells: dict, session: str) -> int:
    """Return how many images a synthetic session has: some of every press, and one of every step of a path."""
    from gelforge.virtual_lab.session import session_cells

    pressed = [cells[name] for name in session_cells(lab, cells)[session]]
    steps = sum(len(cell.depths_mm) for cell in pressed if cell.follows_a_path)
    presses = sum(len(cell.depths_mm) for cell in pressed if not cell.follows_a_path)
    return steps + presses * lab.imaging.images_per_press


def megapixels(camera: Camera) -> float:
    return camera.width_px * camera.height_px / 1e6


def row_bytes(study: Study) -> int:
    """Return the bytes of a row of a shard, before compression; its few words count nothing."""
    features, bins = 2 * study.features.regions**2, study.sensor.bins.nx * study.sensor.bins.ny
    wide = {"f4": 4, "f8": 8, "i4": 4, "bool": 1, "text": 0}
    return sum(math.prod(c.sizes(features, bins)) * wide[c.kind] for c in columns(False).values())


def grid_points(study: Study) -> float:
    """Return about how many points keep the softening of a sensor and of its companion, whose grid is twice as wide."""
    sensor, spacing = study.sensor, study.mechanics.effects.history.grid_mm
    return (1 + 1 / 8) * sensor.width_x_mm * sensor.width_y_mm * sensor.height_mm / spacing**3


def mesh_size(study: Study, sizes: Mesh, cell) -> tuple[int, int]:
    """Return the unknowns and the number of surface nodes of a cell's mesh."""
    from gelforge.indentation.sensor.sensor_mesh import sensor_mesh

    mesh = sensor_mesh(study.sensor, sizes, cell.x_mm, cell.y_mm)
    return 3 * int((~mesh.hanging).sum()), len(mesh.surface.nodes)


def read_costs() -> pd.DataFrame:
    """Return measured cells: kind ("solved" or "mirrored"), degrees_of_freedom, cpu_s."""
    from gelforge.csv_table import read_csv

    return read_csv(MEASURED, numbers=("degrees_of_freedom", "cpu_s"), texts=("kind",))


def cell_seconds(measured: pd.DataFrame, unknowns: int) -> float:
    """Return the CPU seconds of a solved cell with 8 depths: the power law through the measured ones."""
    import numpy as np

    solved = measured[measured["kind"] == "solved"]
    exponent, level = np.polyfit(np.log(solved["degrees_of_freedom"]), np.log(solved["cpu_s"]), 1)
    return float(np.exp(level) * unknowns**exponent)
