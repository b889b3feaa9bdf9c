"""`gelforge mismatch-materials`: what a law fitted to one loading leaves out of all other tests of a material."""

from __future__ import annotations

from pathlib import Path

from gelforge.materials.readers.material_source import read_sources
from gelforge.mismatch.material.material_tests import SEED, judge_sources, write_judged
from gelforge.progress import Stages


def mismatch_materials(sources: list[Path], mapping: Path | None, out: Path, seed: int = SEED) -> None:
    """Write verdict.json and material_readings.csv of each material's stress tests and of each press and pair."""
    with Stages("verdict on material tests"):
        effects, reasons = judge_sources(read_sources(sources, mapping), seed)
    for judged in effects:
        folder = out / judged.name if len(effects) > 1 else out
        write_judged(folder, judged)
        fit = judged.verdict.fit
        errors = (f"{score.rmse_N[2]:.3g}" for score in (fit.before, fit.after) if score)
        print(f"{judged.verdict.title}\n{judged.verdict.state}: {judged.verdict.sentence}")
        print(f"root mean square error [MPa, or N of indentations and pairs]: {' -> '.join(errors)}")
        print(f"written to {folder}\n")
    for reason in reasons:
        print(f"not judged: {reason}")
