"""The protocol of docs/protocol.md as a mock run: eight known interventions, and what a verdict says of each. SYNTHETIC.

The small sensor of free_forms.py, pressed at 25 places to three depths and held, by our own solver on another mesh, with
noise, zeros and errors of the depth. One intervention a case, of a size that a laboratory would choose; the study knows
nothing of it. Truth and analysis have the same form, so this shows that the steps work, not that any sensor obeys them:
what verdicts are worth is in docs/validation.md. Printed by case: what was done, SNR, state, what is said, the value with
its interval next to the true one, and seconds.

usage: python benchmarks/protocol.py [--only shim void] [--kept FOLDER]       (one thread; one to four minutes a case)
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from free_forms import ALONG, NOISE_N, PRESS_MM, PRESS_S, said, small_study

from gelforge.config import Study, study_from
from gelforge.config.basis.variants import merged
from gelforge.laws_of_study import laws_and_doubts, material_laws_of
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.fem.nominal import observations_of, problem_of
from gelforge.mismatch.fem.solutions import Solver
from gelforge.mismatch.fem.solver import base_of, forces_with
from gelforge.mismatch.inference.judge import judge
from gelforge.mismatch.readings.observations import Observations
from gelforge.mismatch.summary.findings import value_entries, values_of

DEPTHS = (0.4, 0.8, 1.2)  # mm
ANALYSIS_MM, TRUTH_MM = 0.4, 0.35  # elements under the ball
HOLDS_S = (0.5, 2.0, 6.0)
SLOW, FAST = 1.0, 10.0  # mm/s
COOL, WARM = 23.0, 33.0  # degC
GRIP = 0.4  # coefficient of friction of the study, where a surface is lubricated
SEED = 40
HEADER = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image"
SESSION = """session: {name}
synthetic: true
base_parameters: exact
temperature_C: {temperature}
force: {{acts_on: sensor, resolution_N: [0.001, 0.001, 0.001]}}
depth_zero: {{by: press, press_scatter_mm: {scatter}}}
"""


@dataclass(frozen=True)
class Intervention:
    """What is done to the sensor or the machine, as an effect of the catalogue at known values."""

    done: str
    effect: str
    theta: tuple[float, ...]
    hyperparameters: dict
    friction: float = 0.0
    speeds: tuple[float, ...] = (SLOW,)
    temperatures: tuple[float, ...] = (COOL,)


INTERVENTIONS = {
    "shim": Intervention("a shim of 0.10 mm under the sensor, zero kept", "contact_zero", (0.10,), {}),
    "ball": Intervention("a second ball, radius 0.5 mm larger", "indenter_radius", (0.5,), {}),
    "lubricant": Intervention("the surface lubricated, 0.4 to 0.1", "friction", (-0.3,), {}, friction=GRIP),
    "speed": Intervention(
        "ten times the speed, on a gel that relaxes",
        "viscoelastic",
        (0.15,),
        {"part": "gel", "time_s": 2.0},
        speeds=(SLOW, FAST),
    ),
    "warmth": Intervention("ten kelvin warmer", "temperature", (0.012,), {}, temperatures=(COOL, WARM)),
    "weights": Intervention(
        "a load cell that reads 6 % too much (dead weights)", "force_gain", (0.06,) * 3, {}
    ),
    "void": Intervention(
        "a drilled void, radius 1.0 mm, 1.5 mm deep",
        "void",
        (1.0,),
        {"x_mm": 6.0, "y_mm": 9.0, "z_mm": -2.5, "radius_mm": 1.0},
    ),
    "spring": Intervention("a spring of 0.10 mm/N in the frame", "frame_compliance", (0.10,), {}),
}


def study_of(case: Intervention, near_mm: float) -> Study:
    """Return the study of the laboratory, which knows nothing of the intervention, on elements of a size."""
    mesh = {"near_mm": near_mm, "near_radius_mm": 2.5, "growth": 0.3, "far_mm": 2.5 * near_mm}
    own = {
        "plan": {"depths_mm": list(DEPTHS)},
        "mechanics": {"friction": case.friction},
        "mismatch": {"coarser": 1.5},
    }
    return study_from(merged(small_study(mesh).model_dump(mode="json"), own))


def write_session(
    folder: Path, case: Intervention, temperature: float, force: np.ndarray | None, rng: np.random.Generator
) -> None:
    """Write a session, every place to every depth at every speed in random order; force (R, 3) [N], or none yet."""
    order = np.random.default_rng(SEED).permutation(len(ALONG) ** 2 * len(DEPTHS) * len(case.speeds))
    ways = [(x, y, d, v) for x in ALONG for y in ALONG for d in DEPTHS for v in case.speeds]
    lines, row = [HEADER], 0
    for number, k in enumerate(order):
        x, y, depth, v = ways[k]
        arrival = depth / v
        course = [("load", arrival, depth)] + [("dwell", arrival + t, depth) for t in HOLDS_S]
        course.append(("unload", arrival + HOLDS_S[-1] + depth / 2 / v, depth / 2))
        zeros = [("zero", -1.0 + 0.1 * k, -1.0) for k in range(3)]
        for phase, at, d in [*zeros, *course]:
            clean = np.array([0.0, 0.0, -0.3 * max(d, 0.0) ** 1.5])
            if force is not None and phase != "zero":
                clean = force[row]
            row += phase != "zero"
            read = clean + (0.0 if force is None else rng.normal(size=3) * NOISE_N)
            when = 2.0 + number * PRESS_S + at
            lines.append(
                f"p{number:03d},,{number},{when:.4f},{phase},{x},{y},{d:.4f},{v},,"
                f"{read[0]:.5f},{read[1]:.5f},{read[2]:.5f},"
            )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "indentations.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    session = SESSION.format(name=folder.name, scatter=PRESS_MM, temperature=temperature)
    (folder / "session.yaml").write_text(session, encoding="utf-8")


def true_forces(case: Intervention, solver: Solver, planned: Observations) -> tuple[np.ndarray, np.ndarray]:
    """Return the forces (R, 3) [N] with the intervention, contact points off by a little, and what it changes (R, 3) [N].

    What changes the body or the way of the indenter is solved by itself; what takes time, or reads the force otherwise, is
    added to the plain sensor's forces.
    """
    effect, theta = CATALOGUE[case.effect], np.array(case.theta)
    base = base_of(solver, planned, [])
    if effect.solved and effect.family != "history":
        changed = effect.to_study(solver.study, case.hyperparameters, tuple(theta))
        force = base_of(replace(solver, study=changed), planned, []).context.force
    else:
        force = forces_with(solver, base, [(effect, case.hyperparameters, theta)])
    presses, which = np.unique(planned.table["press"], return_inverse=True)
    off = np.random.default_rng(SEED + 1).normal(0, PRESS_MM, len(presses))[which]
    return force + off[:, None] * base.context.slope(), force - base.context.force


def row_of(name: str, folder: Path, kept: Path) -> dict:
    """Return what a verdict says of one intervention."""
    case = INTERVENTIONS[name]
    study, true = study_of(case, ANALYSIS_MM), study_of(case, TRUTH_MM)
    laws, _ = laws_and_doubts(material_laws_of(study, []))
    solver = Solver(study, laws, {}, kept)
    sessions = [folder / f"{name}_{t:g}" for t in case.temperatures]
    rng = np.random.default_rng(SEED + 2)
    for session, temperature in zip(sessions, case.temperatures):
        write_session(session, case, temperature, None, rng)
    planned = observations_of(sessions, study)[0]
    force, change = true_forces(case, replace(solver, study=true, kept=kept), planned)
    for session, temperature in zip(sessions, case.temperatures):
        own = (planned.table["session"] == session.name).to_numpy()
        write_session(session, case, temperature, force[own], rng)
    began = time.perf_counter()
    problem, _ = problem_of(solver, observations_of(sessions, study)[0])
    found = judge(problem, study.mismatch, study.seed)
    return {
        "done": case.done,
        "SNR": float(np.linalg.norm(problem.covariance.whiten(problem.observations.flat(change)))),
        "must be": case.effect,
        "state": found.state,
        "said": said(found),
        "value and 90 %": value_of(problem, found, case),
        "true": ", ".join(f"{a:g}" for a in case.theta),
        "s": time.perf_counter() - began,
    }


def value_of(problem, found, case: Intervention) -> str:
    """Return the values of the intervention's effect with their intervals, or of what stands for it in its group.

    Empty where neither is in the answer.
    """
    if found.answer is None:
        return ""
    fit, groups = found.answer.fit, found.answer.groups
    own = [case.effect in {*group.names} for group in groups]
    if not any(own):
        return ""
    k = own.index(True)
    part = fit.parts[k]
    _, theta, spread = values_of(fit, part.name)
    entries = value_entries(problem.effects[part.name].parameters, theta, spread)
    words = [f"{e.value:.3g} ({e.interval_90[0]:.3g} to {e.interval_90[1]:.3g})" for e in entries]
    if part.located:
        words.append(", ".join(f"{key} {float(v):.2f}" for key, v in part.hyperparameters.items()))
    return "; ".join(words) + ("" if part.name == case.effect else f", {part.name}")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--only", nargs="+", choices=INTERVENTIONS, default=list(INTERVENTIONS))
    parser.add_argument("--kept", type=Path, help="folder for solutions; a temporary one if left out")
    asked = parser.parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as temporary:
        for name in asked.only:
            rows.append(row_of(name, Path(temporary), asked.kept or Path(temporary) / "kept"))
            print(rows[-1], flush=True)
    print()
    print(pd.DataFrame(rows).to_markdown(index=False, floatfmt=".3g", missingval=""))


if __name__ == "__main__":
    main()
