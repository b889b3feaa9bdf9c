"""One fault in the code of each battery of tests: whoever thins the tests out sees whether they still catch it.

The checkout is copied to one folder, which keeps its compiled kernels; there one line is spoilt, the battery's test is run
and must fail, and the line is mended again. A text that is not there is an error: the list follows the code.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
COPY = ROOT / "results/faults/code"
CARRIED = ("gelforge", "tests", "benchmarks", "workflow", "config", "data", "docs")
FILES = ("Snakefile", "pyproject.toml", "Makefile", "README.md", "requirements.lock")


@dataclass(frozen=True)
class Fault:
    """A text of a file, what stands in its place, and the tests that must fail then."""

    battery: str
    path: str
    whole: str
    wrong: str
    tests: str


FAULTS = tuple(
    Fault(*one)
    for one in [
        ("constitutive models", "gelforge/mechanics/laws/models/ogden.py",
         "return sum(m * lam**a for m, a in zip(self.mu, self.alpha))",
         "return sum(m * lam**a for m, a in zip(self.mu, self.alpha)) * 1.01",
         "tests/mechanics/test_laws.py"),
        ("elements", "gelforge/mechanics/meshes/elements.py", "return HEX8_CORNERS * others / 8",
         "return HEX8_CORNERS * others / 8.01", "tests/mechanics/test_elements.py"),
        ("indenters", "gelforge/mechanics/indenters/shapes.py", "return r - self.radius, normal, turn",
         "return r - 1.01 * self.radius, normal, turn", "tests/mechanics/test_indenters.py"),
        ("symmetry", "gelforge/indentation/sensor/symmetry.py",
         "moved[..., :2] = moved[..., :2] @ D4[name].T", "moved[..., :2] = moved[..., :2] @ D4[name]",
         "tests/indentation/test_symmetry.py"),
        ("bins", "gelforge/indentation/cells/binning.py",
         "np.broadcast_to((bins.nx * index[..., 1] + index[..., 0])[..., None], value.shape)",
         "np.broadcast_to((bins.nx * index[..., 0] + index[..., 1])[..., None], value.shape)",
         "tests/indentation/test_binning.py"),
        ("effects", "gelforge/indentation/effects/catalogue.py",
         "changed = {name: (1 + amount) * factors.get(name, 1.0) for name in layers}",
         "changed = {name: (1 - amount) * factors.get(name, 1.0) for name in layers}",
         "tests/indentation/test_effects_battery.py -k sign_is_the_physical_one[gel_stiffness]"),
        ("derivatives", "gelforge/indentation/solving/sensitivities.py",
         "return (with_it.arrays[array] - without.arrays[array]) / variation.amount",
         "return (with_it.arrays[array] - without.arrays[array]) / (1.2 * variation.amount)",
         "tests/indentation/test_stored_sensitivities.py -k subtracted_derivative_predicts"),
        ("interpolation", "gelforge/interpolation/weights.py", "return weights / weights.sum()",
         "return weights", "tests/interpolation/test_between_sites.py -k smooth_field or weights_of_error_bars"),
        ("units", "gelforge/units.py", '"kPa": 1e-3', '"kPa": 1e-2', "tests/materials/test_mapping.py"),
        ("checksums", "gelforge/files/seals.py", "if found != stated:", "if False:", "tests/test_products.py"),
        ("tables of a verdict", "gelforge/mismatch/result/verdict_tables.py",
         "    check_seal(path, REMEDY, VerdictError, stated)\n", "",
         "tests/mismatch/test_verdict.py -k not_the_verdicts"),
        ("tables", "gelforge/csv_table/cells.py", "if not math.isfinite(value):", "if False:",
         "tests/test_csv_table.py tests/recording/test_readings.py"),
        ("tables: values in their columns", "gelforge/csv_table/table.py", "if len(cells) > max(named, usual):", "if False:",
         "tests/test_csv_table.py -k separator_too_many"),
        ("parameter at its bound", "gelforge/materials/fitting/choice.py", "if not best.fitted.at_bound:", "if True:",
         "tests/materials/test_any_rank.py -k gives_way"),
        ("rank of a covariance", "gelforge/materials/fitting/law_file.py",
         "np.flatnonzero(variance > 0)", "np.arange(len(variance))",
         "tests/materials/test_any_rank.py -k any_rank_goes"),
        ("configuration", "gelforge/section.py", 'extra="forbid", frozen=True',
         'extra="ignore", frozen=True', "tests/test_config.py"),
        ("imports", "gelforge/mechanics/upward.py", "", "import gelforge.report.page\n",
         "tests/test_imports.py"),
        ("forces of a recording", "gelforge/recording/readings.py",
         "return sign * raw @ np.asarray(force.axes, dtype=float).T",
         "return sign * raw @ np.asarray(force.axes, dtype=float)", "tests/recording/test_readings.py"),
        ("camera", "gelforge/recording/optics/camera.py", "return np.asarray(camera.centre_px) + seen, distance",
         "return np.asarray(camera.centre_px) - seen, distance", "tests/recording/test_camera.py"),
        ("plausibility: silence", "gelforge/recording/plausibility/forces.py", "SILENT_SHARE = 0.1",
         "SILENT_SHARE = 1e-4", "tests/recording/test_plausibility.py -k left_out_and_listed"),
        ("plausibility: honest sessions", "gelforge/recording/plausibility/forces.py", "SAME_WAY = 0.9",
         "SAME_WAY = 1.1", "tests/recording/test_plausibility.py -k honest"),
        ("hysteresis", "gelforge/materials/covariates/hysteresis.py", "return (loaded - returned) / loaded",
         "return (loaded - returned) / returned", "tests/materials/test_histories.py"),
        ("shared measurements", "gelforge/units.py", '"gf": 9.80665e-3', '"gf": 9.80665',
         "tests/materials/test_shared_files.py"),
        ("held-out positions", "gelforge/dataset/splits.py",
         'return {cell: "test" if orbit[cell] in test else "train" for cell in sorted(orbit)}',
         'return {cell: "test" if cell in test else "train" for cell in sorted(orbit)}',
         "tests/dataset/test_splits.py"),
        ("scattered positions", "gelforge/dataset/splits.py",
         "first = chained(folded(_places(planned), sensor), _tolerance_mm(planned))",
         "first = chained(folded(_places(planned), sensor), 0.0)",
         "tests/dataset/test_splits.py -k scatter"),
        ("distance to training", "gelforge/dataset/splits.py",
         "return cKDTree(folded(others, sensor)).query(folded(places, sensor))[0]",
         "return cKDTree(others).query(places)[0]", "tests/learning/test_evaluation.py -k nearest_mirror"),
        ("tolerance of positions", "gelforge/indentation/paths/places.py",
         "return gap_mm <= tolerance_mm + ROUNDING_MM", "return gap_mm < tolerance_mm",
         "tests/indentation/test_recorded_plan.py -k at_the_tolerance"),
        ("plans from sessions", "gelforge/indentation/paths/places.py",
         "site[number], named[nearest] = nearest, named[nearest] or named[number]", "pass",
         "tests/indentation/test_recorded_plan.py -k one_site_with_all"),
        ("robot's frame", "gelforge/indentation/sensor/stage_frame.py",
         "return np.array([[c, -s], [s, c]]) @ H", "return np.array([[c, s], [-s, c]]) @ H",
         "tests/importing/test_documented_frames.py"),
        ("images by content", "gelforge/recording/imaging/image_digest.py",
         "return digest({name: [states[name][0], content[name]] for name in paths})",
         "return digest({name: states[name][0] for name in paths})",
         "tests/recording/test_image_digest.py"),
        ("copied sessions", "gelforge/recording/copies.py", "SAME_SHARE = 0.5", "SAME_SHARE = 1.5",
         "tests/recording/test_copies.py"),
        ("turned images", "gelforge/learning/basis/turns.py", '"ab,Nbk->Nak"', '"ba,Nbk->Nak"',
         "tests/learning/test_turns.py"),
        ("intervals of a network", "gelforge/learning/models/reliability.py",
         "return np.sort(error, axis=0)[rank]", "return np.sort(error, axis=0)[rank // 2]",
         "tests/learning/test_reliability.py"),
        ("errors of a network", "gelforge/learning/judging/evaluation.py",
         "return float(np.sqrt(np.mean(values**2))) if len(values) else np.nan",
         "return float(np.mean(np.abs(values))) if len(values) else np.nan",
         "tests/learning/test_evaluation.py"),
        ("particles", "gelforge/virtual_lab/particles.py",
         'return int.from_bytes(hashlib.sha256(serial.encode()).digest()[:8], "little")', "return 7",
         "tests/virtual_lab/test_particles.py tests/virtual_lab/test_sessions.py"),
        ("covariance", "gelforge/mismatch/evidence/covariance.py",
         "float(np.log(self.variance).sum() + sum(", "float(0.5 * np.log(self.variance).sum() + sum(",
         "tests/mismatch/test_covariance.py"),
        ("global test: calibration", "gelforge/mismatch/inference/scan.py",
         "variance = 2 * estimated.tails * count", "variance = 4 * estimated.tails * count",
         "tests/mismatch/test_scan.py -k global_p_is_uniform"),
        ("scan: a false-alarm rate of 10 %", "gelforge/mismatch/inference/scan.py",
         "return Scan(ranked, float(p))", "return Scan(ranked, float(p) / 4)",
         "tests/mismatch/test_scan.py -k scan_is_calibrated"),
        ("fitted amounts in a scan", "gelforge/mismatch/inference/scan.py",
         "values -= Q @ (Q.T @ values)", "pass", "tests/mismatch/test_scan.py -k neither_helps"),
        ("evidence", "gelforge/mismatch/evidence/screen.py",
         "average = float(logsumexp(factors) - np.log(len(factors)))", "average = float(max(factors))",
         "tests/mismatch/test_screen.py"),
        ("zero rows", "gelforge/mismatch/readings/errors.py",
         "np.hypot(trend, np.sqrt(of_trend)), np.sqrt(ratio * variance)",
         "np.hypot(trend, np.sqrt(of_trend)), np.sqrt(ratio) * variance",
         "tests/mismatch/test_zeros_together.py"),
        ("single readings", "gelforge/mismatch/inference/scan.py", "SPIKE = 5.0", "SPIKE = 50.0",
         "tests/mismatch/test_spikes.py -k set_aside"),
        ("names of a verdict", "gelforge/mismatch/thresholds.py", "SURE = 0.9", "SURE = 0.5",
         "tests/mismatch/test_judge.py -k not_sure"),
        ("synthetic data in a report", "gelforge/report/chapters/study_chapters.py",
         'label = "SYNTHETIC image" if session.synthetic else "Image"', 'label = "Image"',
         "tests/report/test_page.py -k synthetic"),
        ("shell text", "workflow/rules/material.smk", ":q}", "}", "tests/workflow/test_quoting.py -k quotes"),
        ("jobs of the workflow", "workflow/rules/common.smk", "math.ceil(len(CELLS) /", "math.floor(len(CELLS) /",
         "tests/workflow/test_dry_run.py -k lists_every_rule"),
    ]
)  # fmt: skip


def run(asked: argparse.Namespace) -> int:
    """Spoil the code of each battery, print the table of which tests noticed and return the exit status."""
    if asked.list:
        print("\n".join(fault.battery for fault in FAULTS))
        return 0
    faults = [fault for fault in FAULTS if asked.only in (None, fault.battery)][: asked.count]
    copied()
    print("| battery | what is spoilt | tests | caught |\n|---|---|---|---|")
    missed = 0
    for fault in faults:
        caught, said = tried(fault)
        missed += not caught
        print(
            f"| {fault.battery} | `{fault.path}` | `{fault.tests}` | {'yes' if caught else 'NO'} |",
            flush=True,
        )
        if asked.verbose or not caught:
            print(said[-1500:], file=sys.stderr)
    return int(bool(missed))


def spoilt(text: str, fault: Fault) -> str:
    """Return a file's text with the fault in it, where its text is first; a new file is nothing else."""
    if fault.whole not in text:
        raise SystemExit(f"{fault.path}: {fault.whole!r} is not there; name a text that is")
    return text.replace(fault.whole, fault.wrong, 1)


def copied() -> None:
    """Bring the copy up to date; time stamps are kept, so that kernels of what is unchanged stay compiled."""
    for name in CARRIED:
        shutil.rmtree(COPY / name, ignore_errors=True)
        shutil.copytree(ROOT / name, COPY / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in FILES:
        shutil.copy2(ROOT / name, COPY / name)


def tried(fault: Fault) -> tuple[bool, str]:
    """Return whether the tests of a fault fail with it, by an assertion and not for want of tests, and what they said."""
    path = COPY / fault.path
    before = path.read_bytes() if fault.whole else b""
    times = path.stat() if fault.whole else None
    path.write_text(spoilt(before.decode(), fault))
    names, _, wanted = fault.tests.partition(" -k ")
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *names.split()]
    shared = os.environ.get("GELFORGE_SHARED", str(ROOT.parent / "shared"))
    try:
        done = subprocess.run(
            [*command, "-k", wanted] if wanted else command,
            cwd=COPY,
            env=os.environ | {"GELFORGE_SHARED": shared, "PYTHONPATH": str(COPY)},
            capture_output=True,
            text=True,
        )
    finally:
        if times:  # as old as it was: kernels stay compiled, and what Python compiled of the spoilt text is not its own
            path.write_bytes(before)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
        else:
            path.unlink()
    return done.returncode == 1, done.stdout + done.stderr
