"""Causes with a free form through the real solver: what a verdict says of maps that no single amount describes. SYNTHETIC.

A small sensor of two layers, pressed at 25 places to four depths. Readings are our own solver's, on a mesh that is not the
analysis': the gel's modulus as a smooth random function of the plane (columns of 1 mm, where the analysis has boxes of
3.5 mm), a wavy surface, a force sensor whose gain follows a curve in time, a gel by Yeoh's model in place of Ogden's, and
nothing. Each has noise, zeros and errors of the depth. Printed by case: state, cause or effects, gain on held-out readings,
its share of what the hidden change itself would gain (oracle), how the map meets the hidden one, and how far the patched
study, solved on its own mesh, is from the figure `after`.

usage: python benchmarks/free_forms.py [--seeds 1 2 3] [--kinds modulus depth gain law nothing] [--kept FOLDER]
       (one thread; some minutes a case)
"""

# ruff: noqa: E402  (threads are set before the libraries start theirs)

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

for _name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ[_name] = "1"

import numpy as np
import pandas as pd
import yaml

from gelforge.config import Study, study_from
from gelforge.config.basis.variants import merged
from gelforge.files import digest
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.inputs import inputs_digest
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models.yeoh import Yeoh
from gelforge.mismatch.evidence.problem import Problem
from gelforge.mismatch.fem.nominal import observations_of, problem_of, with_known
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.fem.solver import base_of
from gelforge.mismatch.inference.judge import Judgement, judge
from gelforge.mismatch.pipeline.stage import write_patch
from gelforge.mismatch.result.verdict import PATCH
from gelforge.mismatch.summary.findings import readings_table, taken_over

WIDTH, GEL_MM, SKIN_MM = 16.0, 3.0, 1.0
ALONG, DEPTHS = (3.0, 5.5, 8.0, 10.5, 13.0), (0.3, 0.6, 0.9, 1.2)  # mm
ANALYSIS = {"near_mm": 0.5, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 1.2}
TRUTH = {"near_mm": 0.4, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 1.0}
NOISE_N, ZERO_ROWS, DWELLS = np.array([0.003, 0.003, 0.006]), 3, 2
PRESS_MM, PRESS_S = 0.008, 12.0  # stage's repeatability; time of a press
COLUMN_MM = 1.0  # of the hidden modulus
MODULUS, WAVE_MM, GAIN = 0.15, 0.05, 0.08  # sizes of what is hidden: rms, amplitude, largest
STIFFER = 0.4  # C20 over C10 of the hidden gel
SOFT = {"mu_kPa": [7.9652, 0.3093], "alpha": [1.2769, 3.5676]}  # Sferrazza et al. 2019, table 1
STIFF = {"mu_kPa": [85.1168, -0.0020], "alpha": [2.8991, -8.2915]}
HEADER = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image"
SESSION = """session: {name}
synthetic: true
base_parameters: exact
force: {{acts_on: sensor, resolution_N: [0.001, 0.001, 0.001]}}
depth_zero: {{by: press, press_scatter_mm: {scatter}}}
"""
Laws = Mapping[str, PrincipalLaw]


@dataclass(frozen=True)
class Hidden:
    """What a recording holds: forces by place and depth, what the force sensor makes of them in time, and the map."""

    force: Callable[[float, float], np.ndarray]  # at a place: (D, 3) [N]
    gain: Callable[[np.ndarray], np.ndarray]  # at shares of the session: factor
    at: Callable[[pd.DataFrame], np.ndarray] | None  # at the rows of module.csv: what the map should say
    cause: str  # the module, or the effect that it should be named as; "" for nothing


def small_study(mesh: Mapping[str, float] = ANALYSIS) -> Study:
    """Return the study: a block of 16 mm, gel under a skin, a wall around."""
    return study_from(
        {
            "study": "free_forms",
            "materials": {"soft": {"parameters": SOFT}, "stiff": {"parameters": STIFF}},
            "sensor": {
                "width_x_mm": WIDTH,
                "width_y_mm": WIDTH,
                "layers": [
                    {"name": "gel", "thickness_mm": GEL_MM, "material": "soft"},
                    {"name": "skin", "thickness_mm": SKIN_MM, "material": "stiff"},
                ],
                "wall_mm": 1.0,
                "bins": {"nx": 8, "ny": 8},
            },
            "plan": {
                "grid": {"spacing_mm": ALONG[1] - ALONG[0], "margin_mm": ALONG[0]},
                "depths_mm": list(DEPTHS),
                "symmetry": "d4",
            },
            "mechanics": {"friction": 0.0, "mesh": dict(mesh)},
            "mismatch": {"draws": 1000},
        }
    )


def pressed(
    study: Study, laws: Laws, x: float, y: float, depths: tuple[float, ...], kept: Path
) -> np.ndarray:
    """Return the forces (D, 3) [N] of a press of a study, solved once."""
    planned = PlannedCell("t", x, y, depths)
    path = kept / f"truth_{digest([inputs_digest(study, dict(laws), planned)])}.npy"
    if not path.is_file():
        cell = simulate_cell(study, dict(laws), planned)
        if not cell.converged:
            raise RuntimeError(f"({x:g}, {y:g}) mm: {cell.attributes['reason']}")
        kept.mkdir(parents=True, exist_ok=True)
        np.save(path, cell.arrays["total_force_N"])
    return np.load(path)


def hidden_of(kind: str, seed: int, laws: Laws, kept: Path) -> Hidden:
    """Return what is hidden in a case of a kind, drawn by the seed."""
    rng = np.random.default_rng([seed, 38])
    true = unmirrored(small_study(TRUTH))

    def as_solved(study: Study = true, by: Laws = laws, deeper=lambda x, y: 0.0):
        return lambda x, y: pressed(
            study, by, x, y, tuple(round(d + float(deeper(x, y)), 6) for d in DEPTHS), kept
        )

    def steady(share):
        return np.ones_like(share)

    if kind == "modulus":
        change = smooth_map(rng)
        study = with_keys(true, geometry={"patches": columns_of(change)})
        in_gel = lambda rows: np.where(rows["z_mm"] < -SKIN_MM, change(rows["x_mm"], rows["y_mm"]), np.nan)  # noqa: E731
        return Hidden(as_solved(study), steady, in_gel, "modulus_map")
    if kind == "depth":
        wave = waves(rng)
        return Hidden(
            as_solved(deeper=wave), steady, lambda rows: wave(rows["x_mm"], rows["y_mm"]), "depth_map"
        )
    if kind == "gain":
        size, bend = GAIN * rng.choice([-1, 1]), rng.uniform(0.3, 0.7)
        curve = lambda s: size * (1 - ((s - bend) / max(bend, 1 - bend)) ** 2)  # noqa: E731
        return Hidden(as_solved(), lambda s: 1 + curve(s), None, "gain_in_time")
    if kind == "law":
        (c10,) = [laws["soft"].shear_modulus / 2]
        return Hidden(
            as_solved(by={**laws, "soft": Yeoh(c10, STIFFER * c10, 0.0)}), steady, None, "strain_energy"
        )
    return Hidden(as_solved(), steady, None, "")


def smooth_map(rng: np.random.Generator) -> Callable:
    """Return a random smooth function over the plane whose root mean square is MODULUS."""
    k = np.arange(3)
    size = rng.normal(size=(3, 3)) / (1 + k[:, None] ** 2 + k**2)
    size[0, 0] = 0.0  # the even part is an effect of the catalogue
    share = np.where(k, 0.5, 1.0)
    size *= MODULUS / np.sqrt(np.sum(size**2 * share[:, None] * share))

    def change(x, y):
        a, b = (np.cos(np.pi * np.asarray(v, float)[..., None] * k / WIDTH) for v in (x, y))
        return np.einsum("...k,kl,...l->...", a, size, b)

    return change


def columns_of(change: Callable) -> list[dict]:
    """Return patches of the configuration: columns through the gel with a relative change of modulus."""
    middles = np.arange(COLUMN_MM / 2, WIDTH, COLUMN_MM)
    return [
        {
            "low_mm": [x - COLUMN_MM / 2, y - COLUMN_MM / 2, -GEL_MM - SKIN_MM],
            "high_mm": [x + COLUMN_MM / 2, y + COLUMN_MM / 2, -SKIN_MM],
            "factor": float(1 + change(x, y)),
        }
        for x in middles
        for y in middles
    ]


def waves(rng: np.random.Generator) -> Callable:
    """Return a wave over the plane [mm] of a random direction, length and phase."""
    angle, length, phase = rng.uniform(0, np.pi), rng.uniform(10.0, 14.0), rng.uniform(0, 2 * np.pi)
    return lambda x, y: WAVE_MM * np.sin(2 * np.pi * (x * np.cos(angle) + y * np.sin(angle)) / length + phase)


def record(hidden: Hidden, seed: int, folder: Path) -> tuple[Path, np.ndarray]:
    """Write a session, every place to every depth in random order, and return it with the forces (R, 3) without noise."""
    rng = np.random.default_rng([seed, 7])
    places = [(x, y) for x in ALONG for y in ALONG]
    presses = [(place, k) for place in places for k in range(len(DEPTHS))]
    truth = {place: hidden.force(*place) for place in places}
    rows, force = [], []
    for number, i in enumerate(rng.permutation(len(presses))):
        place, k = presses[i]
        curve = np.vstack([np.zeros(3), truth[place]])
        slope = np.gradient(curve, np.array([0.0, *DEPTHS]), axis=0)[k + 1]
        start = number * PRESS_S
        course = [("zero", 0.1 * z, -1.0) for z in range(ZERO_ROWS)]
        course += [("load", 3.0, DEPTHS[k]), *(("dwell", 3.5 + 0.5 * d, DEPTHS[k]) for d in range(DWELLS))]
        off = rng.normal(0, PRESS_MM)
        for phase, at, depth in course:
            rows.append((f"p{number:03d}", number, start + at, phase, *place, depth))
            force.append((np.zeros(3), np.zeros(3)) if phase == "zero" else (truth[place][k], off * slope))
    clean, errors = (np.array(part) for part in zip(*force))
    share = np.array([row[1] for row in rows]) / (len(presses) - 1)
    clean = clean * hidden.gain(share)[:, None]
    read = clean + errors + rng.normal(size=clean.shape) * NOISE_N
    lines = [
        f"{p},,{order},{t:.3f},{phase},{x},{y},{d},1,,{f[0]:.5f},{f[1]:.5f},{f[2]:.5f},"
        for (p, order, t, phase, x, y, d), f in zip(rows, read)
    ]
    folder.mkdir(parents=True)
    (folder / "indentations.csv").write_text("\n".join([HEADER, *lines]) + "\n", encoding="utf-8")
    (folder / "session.yaml").write_text(SESSION.format(name=folder.name, scatter=PRESS_MM), encoding="utf-8")
    return folder, clean[[row[3] != "zero" for row in rows]]


def row_of(kind: str, seed: int, solver: Solver, folder: Path) -> dict:
    """Return what the judge says of one case."""
    hidden = hidden_of(kind, seed, solver.laws, solver.kept)
    session, clean = record(hidden, seed, folder / "s1")
    began = time.perf_counter()
    problem, _ = problem_of(solver, observations_of([session], solver.study)[0])
    found = judge(problem, solver.study.mismatch, solver.study.seed)
    seconds = time.perf_counter() - began
    if taken_over(found):
        write_patch(folder, solver.study, problem, found)
    true = problem.observations.flat(clean)
    model = found.model
    row = {
        "hidden": kind,
        "seed": seed,
        "SNR": float(
            np.linalg.norm(problem.covariance.whiten(true - problem.observations.flat(problem.base)))
        ),
        "state": found.state,
        "said": said(found),
        "log gain": None if model is None else model.held.gain,
        "of the oracle's": share_of_oracle(problem, found, true),
        **map_row(found, hidden),
        **patch_row(solver, problem, found, folder / PATCH),
        "s": seconds,
    }
    return row


def said(found: Judgement) -> str:
    """Return cause and sure effects of a judgement with their probability, else what is likeliest."""
    parts = []
    if found.model is not None:
        cause = found.model.module.name if found.model.module is not None else found.model.kernel.words
        parts.append(f"{cause} {found.model.probability:.2f}")
    alone = found.model is not None and not found.model.with_effects and found.model.sure
    if found.answer is not None and not alone:
        parts += [f"{' | '.join(g.names)} {g.probability:.2f}" for g in found.answer.groups]
    return "; ".join(parts)


def share_of_oracle(problem: Problem, found: Judgement, true: np.ndarray) -> float | None:
    """Return of the held-out readings' mean square by how much of what the hidden change would take off it falls."""
    table = readings_table(problem, found)
    held = (table["held_out"] != "no").to_numpy()
    by = [true if name is None else table[name].to_numpy(float) for name in ("base_N", "predicted_N", None)]
    if not np.isfinite(by[1]).all():
        by[1] = by[0]
    square = [np.mean(((table["measured_N"] - one) / table["sigma_N"]).to_numpy()[held] ** 2) for one in by]
    return float((square[0] - square[1]) / (square[0] - square[2])) if square[0] > 1.05 * square[2] else None


def map_row(found: Judgement, hidden: Hidden) -> dict:
    """Return how the map meets the hidden one: correlation, share of its rms that is left, share within 2 sigma."""
    if (
        found.model is None
        or found.model.module is None
        or found.model.module.name != hidden.cause
        or hidden.at is None
    ):
        return {}
    table = found.model.map()
    true = np.asarray(hidden.at(table), float)
    known = np.isfinite(true)
    true, mean, sigma = true[known], table["mean"].to_numpy()[known], table["sigma"].to_numpy()[known]
    return {
        "map: correlation": float(np.corrcoef(true, mean)[0, 1]),
        "left": float(np.sqrt(np.mean((true - mean) ** 2) / np.mean(true**2))),
        "within 2 sd": float(np.mean(np.abs(true - mean) < 2 * sigma)),
    }


def patch_row(solver: Solver, problem: Problem, found: Judgement, patch: Path) -> dict:
    """Return the largest difference of the patched study's own presses from `after`, and of the base, in % of Fz."""
    if not patch.is_file() or not (keys := yaml.safe_load(patch.read_text(encoding="utf-8"))):
        return {}
    study = study_from(merged(solver.study.model_dump(mode="json"), keys))
    patched = replace(solver, study=study)
    force = with_known(base_of(patched, problem.observations, []), patched).context.force
    table = readings_table(problem, found)
    z = (table["axis"] == "z").to_numpy()
    presses, after, base = (
        values[z]
        for values in (
            problem.observations.flat(force),
            table["after_N"].to_numpy(),
            table["base_N"].to_numpy(),
        )
    )
    return {
        "patch - after [% Fz]": float(100 * np.max(np.abs(presses - after) / np.abs(base))),
        "after - base [% Fz]": float(100 * np.max(np.abs(after - base) / np.abs(base))),
    }


KINDS = ("modulus", "depth", "gain", "law", "nothing")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2, 3])
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--kept", type=Path, help="folder for solutions; a temporary one if left out")
    asked = parser.parse_args()
    study, rows = small_study(), []
    laws, _ = laws_and_doubts(material_laws_of(study, []))
    with tempfile.TemporaryDirectory() as temporary:
        solver = Solver(study, laws, {}, asked.kept or Path(temporary) / "kept")
        for seed in asked.seeds:
            for kind in asked.kinds:
                rows.append(row_of(kind, seed, solver, Path(temporary) / f"{kind}_{seed}"))
                print({key: value for key, value in rows[-1].items()}, flush=True)
    print()
    print(pd.DataFrame(rows).to_markdown(index=False, floatfmt=".2f", missingval=""))


if __name__ == "__main__":
    main()
