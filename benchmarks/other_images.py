"""What a network makes of images of other particles, cameras, lenses and gels: its errors, and how many images are marked.

usage: python benchmarks/other_images.py [results/benchmark] [--data data/benchmark] [--gels results/other_gels]
       (one thread; two minutes, and ten CPU seconds for each cell of another gel, which is kept)

All data is SYNTHETIC: the true motion of the virtual lab's test presses, drawn anew. Prints a Markdown table.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[name] = "1"

import argparse  # noqa: E402
from collections.abc import Callable  # noqa: E402
from dataclasses import dataclass  # noqa: E402
from pathlib import Path  # noqa: E402

import cv2  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from force_errors import force_errors  # noqa: E402

from gelforge.config import Camera, Study, VirtualLab, load_study, load_virtual_lab  # noqa: E402
from gelforge.dataset.splits import planned_split  # noqa: E402
from gelforge.indentation.cells.cell_file import Cell, read_cell, write_cell  # noqa: E402
from gelforge.indentation.paths.planned_cell import PlannedCell  # noqa: E402
from gelforge.indentation.planning.plan import plan_cells  # noqa: E402
from gelforge.learning.models.model_file import Model, load_model  # noqa: E402
from gelforge.recording.features import FlowFeatures  # noqa: E402
from gelforge.recording.imaging.flow import reduced  # noqa: E402
from gelforge.recording.optics.remap import Remapper  # noqa: E402
from gelforge.virtual_lab.imaging import draw, expose, focused  # noqa: E402
from gelforge.virtual_lab.particles import place_particles, true_motion  # noqa: E402
from gelforge.virtual_lab.true_solutions import TRUTH  # noqa: E402
from gelforge.virtual_lab.truth import simulate_truth_cell  # noqa: E402

PLANE_Z_MM = -3.75  # of the remap: the middle of the gel
GEL_SITES = 6
SEEDS = 3
Picture = Callable[[np.ndarray], np.ndarray]


def as_is(image: np.ndarray) -> np.ndarray:
    return image


@dataclass(frozen=True)
class Kind:
    """Images of one kind: the camera that takes them, what is done to each, and to those that are taken after a touch."""

    camera: Camera
    picture: Picture = as_is
    spoilt: Picture = as_is  # the lens was touched after the reference image


def moved(camera: Camera, times: float) -> Camera:
    """Return a camera of 1 % more focal length, 2 px aside and turned by half a degree about each axis, times over."""
    return camera.model_copy(
        update={
            "focal_px": camera.focal_px * (1 + 0.01 * times),
            "centre_px": list(np.add(camera.centre_px, [2.0 * times, -2.0 * times])),
            "rotation_deg": list(np.add(camera.rotation_deg, [0.5 * times, -0.5 * times, 0.5 * times])),
        }
    )


def smeared(radius_px: int) -> Picture:
    """Return what a fingerprint at a third of the image does: a disc out of focus and paler."""

    def spoil(image: np.ndarray) -> np.ndarray:
        height, width = image.shape
        v, u = np.mgrid[:height, :width]
        inside = np.hypot(u - width / 3, v - height / 3) < radius_px
        cover = cv2.GaussianBlur(inside.astype(np.float32), (0, 0), radius_px / 8)
        pale = 0.6 * cv2.GaussianBlur(image, (0, 0), 6) + 0.4 * float(image.mean())
        return (image * (1 - cover) + pale * cover).astype(np.float32)

    return spoil


def kinds(camera: Camera) -> dict[str, Kind]:
    near, far = (
        moved(camera, 1),
        moved(camera, 5),
    )  # the farther one sees too little of the view to be remapped to it
    return {
        "the same camera, other particles": Kind(camera),
        "camera moved (1 %, 2 px, 0.5 deg)": Kind(near),
        "the same, remapped": Kind(near, Remapper(near, camera, PLANE_Z_MM)),
        "camera moved five times as much": Kind(far),
        "lens touched, 40 px": Kind(camera, spoilt=smeared(40)),
        "lens touched, 80 px": Kind(camera, spoilt=smeared(80)),
    }


def gels(lab: VirtualLab, study: Study) -> dict[str, tuple[Study, VirtualLab]]:
    """Return sensors with another gel: stiffer, softer skin, thinner."""
    layers = study.sensor.layers
    thinner = [
        layer.model_copy(update={"thickness_mm": 0.6 * layer.thickness_mm})
        if layer.particle_volume_fraction
        else layer
        for layer in layers
    ]
    skin = next(layer.name for layer in layers if not layer.particle_volume_fraction)
    scale = lab.stiffness_scale
    thin = study.model_copy(update={"sensor": study.sensor.model_copy(update={"layers": thinner})})
    soft = lab.model_copy(update={"stiffness_scale": scale | {skin: 0.25}})
    stiff = lab.model_copy(update={"stiffness_scale": {name: 1.5 * scale.get(name, 1.0) for name in
                                                       (layer.name for layer in layers)}})  # fmt: skip
    return {
        "gel and skin 1.5 times as stiff": (study, stiff),
        "skin a quarter as stiff": (study, soft),
        "gel 0.6 times as thick": (thin, lab),
    }


def images(
    study: Study, lab: VirtualLab, cells: list[tuple[PlannedCell, Cell]], kind: Kind, seed: int
) -> np.ndarray:
    """Return the features (n, 2 m) of one image of each cell and depth, with particles of a seed."""
    particles = place_particles(lab.particles, study.sensor, f"other-{seed}")
    imaging, rng = focused(lab.imaging, particles), np.random.default_rng([seed, 5])
    diameter = lab.particles.diameter_mm

    def seen(centres: np.ndarray, picture: Picture) -> np.ndarray:
        drawn = picture(draw(kind.camera, imaging, centres, diameter))
        return reduced(kind.picture(expose(drawn, imaging, rng)), study.features.image_scale)

    extract = FlowFeatures(seen(particles, as_is), study.features)
    found = []
    for planned, truth in cells:
        motion = true_motion(truth, planned, particles, study.sensor.width_x_mm)
        for depth in planned.depths_mm:
            found.append(extract(seen(particles + motion.displacement(depth), kind.spoilt)))
    return np.array(found)


def test_presses(
    study: Study, results: Path, data: Path
) -> tuple[list[tuple[PlannedCell, Cell]], np.ndarray]:
    """Return the cells of the test split with their truth, and the labels (n, B, 3) [N] of their depths."""
    planned = plan_cells(study)
    split, _ = planned_split(planned, study.sensor, study.dataset.test_fraction, study.seed)
    tested = [cell for name, cell in planned.items() if split[name] == "test"]
    truth = data / "virtual_truth" / "cells"
    cells = [(c, read_cell(truth / f"{c.source or c.name}.h5", TRUTH)) for c in tested]
    labels = [read_cell(results / "cells" / f"{c.name}.h5").arrays["bin_force_N"] for c in tested]
    return cells, np.concatenate(labels).astype(float)


def errors(model: Model, features: np.ndarray, label: np.ndarray, grid: tuple) -> dict[str, float]:
    force = model.predict(features)
    found = force_errors(force, label, np.zeros(len(label), bool), grid)
    shown = {name: found[name] for name in ("RMSES z [mN]", "total Fz [mN]", "CoP median [mm]")}
    return shown | {"marked [%]": 100 * float((model.disagreement(features, force) > 1).mean())}


def kept(path: Path, study: Study, lab: VirtualLab, planned: PlannedCell) -> Cell:
    """Return the truth cell of another gel, solved once."""
    if not path.is_file():
        print(f"solving {path}", flush=True)
        write_cell(path, simulate_truth_cell(study, lab, planned))
    return read_cell(path)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("results", nargs="?", type=Path, default=Path("results/benchmark"))
    parser.add_argument("--data", type=Path, default=Path("data/benchmark"))
    parser.add_argument("--gels", type=Path, default=Path("results/other_gels"))
    arguments = parser.parse_args()
    study = load_study(arguments.results / "study.yaml")
    lab = load_virtual_lab(study.virtual_lab)
    model = load_model(arguments.results / "model" / "model.pt")
    cells, label = test_presses(study, arguments.results, arguments.data)
    bins = study.sensor.bins
    grid = bins.nx, bins.ny, np.array([study.sensor.width_x_mm, study.sensor.width_y_mm])

    def row(about: Study, bench: VirtualLab, pressed: list, kind: Kind, of: np.ndarray) -> dict[str, float]:
        runs = [errors(model, images(about, bench, pressed, kind, seed), of, grid) for seed in range(SEEDS)]
        return dict(pd.DataFrame(runs).median())

    table = {name: row(study, lab, cells, kind, label) for name, kind in kinds(lab.camera).items()}
    own = [c for c, _ in cells if c.source is None or c.source == c.name][:GEL_SITES]
    for number, (name, (about, bench)) in enumerate(gels(lab, study).items()):
        arguments.gels.mkdir(parents=True, exist_ok=True)
        pressed = [(c, kept(arguments.gels / f"{number}_{c.name}.h5", about, bench, c)) for c in own]
        loaded = np.concatenate([c.arrays["bin_force_N"][: len(p.depths_mm)] for p, c in pressed]).astype(
            float
        )
        table[name] = row(about, bench, pressed, Kind(lab.camera), loaded)
    print(
        f"\n{len(label)} images of {len(cells)} test sites (gels: {len(own)} sites), medians over {SEEDS} patterns:\n"
    )
    print(pd.DataFrame(table).T.to_markdown(floatfmt=".3g"))


if __name__ == "__main__":
    main()
