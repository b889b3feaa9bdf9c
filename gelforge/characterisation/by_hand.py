"""Characterisation without a study: folders or files of tests in, one folder of results per material out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.characterisation.bootstrap import bootstrap as bootstrap_samples
from gelforge.characterisation.characterise import curve_table, material_law
from gelforge.characterisation.choice import Comparison, compare_laws
from gelforge.characterisation.common_form import MaterialTest
from gelforge.characterisation.curves import MeanCurve, mean_curves, monotonic_loading
from gelforge.characterisation.fit import FitError, LawFit
from gelforge.characterisation.law_file import write_law
from gelforge.characterisation.mapped_files import read_mapped, read_mapped_folder
from gelforge.characterisation.material_table import material_table
from gelforge.characterisation.material_tests import declared_synthetic, input_files, read_material_tests
from gelforge.config_mapping import Mapping, load_mapping
from gelforge.csv_table import TableError
from gelforge.files import digest, file_sha256, write_table, write_text

SEED = 20191113  # of the bootstrap; the same files give the same intervals


@dataclass(frozen=True)
class MaterialSource:
    """The tests of one material, where they came from, and what was left out on reading."""

    name: str
    tests: tuple[MaterialTest, ...]
    files: tuple[Path, ...]
    synthetic: bool
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Characterised:
    """What was found for one material and which law files were written beside the chosen one."""

    name: str
    comparison: Comparison
    notes: tuple[str, ...]
    other_laws: tuple[Path, ...]

    @property
    def summary(self) -> str:
        """Return in a few lines which law was chosen, why, and what to beware of."""
        law = self.comparison.chosen.fit.law
        lines = [
            f"{self.name}: {self.comparison.reason}",
            f"  E = {law.youngs_modulus * 1e3:.4g} kPa; R2 of the nominal stress: "
            + ", ".join(f"{test} {r2:.4f}" for test, r2 in self.comparison.chosen.fit.r2_nominal.items()),
        ]
        return "\n".join([*lines, *(f"  ! {text}" for text in (*self.comparison.warnings, *self.notes))])


def read_tests(sources: list[Path], mapping: Path | None) -> list[MaterialSource]:
    """Return the materials found in folders and files, in the order of their names.

    With a mapping (YAML) any table is read; without, a folder with samples.csv. Raises TableError.
    """
    declared = load_mapping(mapping) if mapping else None
    found: dict[str, list] = {}
    for source in map(Path, sources):
        files, tests, synthetic = _read(source, declared)
        for test in tests:
            found.setdefault(getattr(test, "material", "") or source.stem, []).append(
                (test, files, synthetic)
            )
    materials = []
    for name, entries in sorted(found.items()):
        fitted = [t for t, _, _ in entries if isinstance(t, MaterialTest)]
        left_out = [
            f"{type(t).__name__} {t.sample}: not fitted by a law" for t, _, _ in entries if t not in fitted
        ]
        files = tuple(dict.fromkeys(f for _, group, _ in entries for f in group))
        if fitted:
            synthetic = any(s for _, _, s in entries)
            materials.append(MaterialSource(name, tuple(fitted), files, synthetic, tuple(left_out)))
    if not materials:
        raise TableError(f"{', '.join(map(str, sources))}: no test to which a law can be fitted; name others")
    return materials


def characterise_tests(
    material: MaterialSource,
    laws: list[str],
    folder: Path,
    loss: str = "linear",
    bootstrap: int = 0,
    workers: int = 1,
) -> Characterised:
    """Write the results of one material into a folder and return them.

    law.json is the chosen law, laws/<name>.json each other one that the tests determine; laws.csv compares them,
    parameters.csv holds parameters with intervals, curves.csv what the figure shows, notes.txt the summary.
    """
    tests, notes = monotonic_loading(list(material.tests))
    notes = [*material.notes, *notes, *_findings(tests)]
    if not tests:
        raise FitError(f"{material.name}: no monotonic test to fit; {'; '.join(notes)}")
    curves = mean_curves(tests)
    try:
        comparison = compare_laws(curves, laws, loss)
    except FitError as error:
        raise FitError(f"{material.name}: {error}") from None
    chosen = comparison.chosen
    inputs = digest({"files": {p.name: file_sha256(p) for p in material.files}, "laws": laws, "loss": loss})
    others, written = [], []
    for candidate in (c for c in comparison.candidates if c.fit):
        path = folder / ("law.json" if candidate is chosen else f"laws/{candidate.name}.json")
        kept = (*notes, *comparison.warnings) if candidate is chosen else notes
        law = material_law(material.name, candidate.fit, inputs, material.synthetic, kept)
        write_law(path, law)
        written.append((candidate, law))
        others += [path] if candidate is not chosen else []
    curve_rows = curve_table(tests, curves, chosen.fit.law)
    write_text(
        folder / "curves.csv", curve_rows.to_csv(index=False, float_format="%.10g", lineterminator="\n")
    )
    write_table(folder, "laws", comparison.table())
    tables = [material_table([law]).assign(law=c.name) for c, law in written]
    parameters = pd.concat(tables, ignore_index=True)
    if bootstrap:
        parameters = with_bootstrap(parameters, curves, chosen.fit, bootstrap, workers)
    write_table(folder, "parameters", parameters)
    result = Characterised(material.name, comparison, tuple(notes), tuple(others))
    write_text(folder / "notes.txt", result.summary + "\n")
    return result


def _findings(tests: list[MaterialTest]) -> list[str]:
    """Return what the readers found odd, each remark once with the tests that it is about."""
    about: dict[str, list[str]] = {}
    for test in tests:
        for text in test.findings:
            about.setdefault(text, []).append(f"{test.test} {test.sample}")
    return [f"{', '.join(names)}: {text}" for text, names in about.items()]


def with_bootstrap(
    table: pd.DataFrame, curves: list[MeanCurve], fit: LawFit, replicates: int, workers: int
) -> pd.DataFrame:
    """Return the table with the bootstrap's 95 % intervals of the fitted law's parameters and modulus beside."""
    drawn = bootstrap_samples(curves, fit, replicates, SEED, workers)
    moduli = np.array([fit.family.law(theta).youngs_modulus * 1e3 for theta in drawn.theta])
    quantities = dict(zip((n.removesuffix("_kPa") for n in fit.family.parameters), drawn.parameters.T)) | {
        "E": moduli
    }
    ends = {name: drawn.interval(values) for name, values in quantities.items()}
    mine = table.law == fit.family.name
    for column, end in (("low_95_bootstrap", 0), ("high_95_bootstrap", 1)):
        table[column] = [ends[q][end] if m and q in ends else np.nan for q, m in zip(table.quantity, mine)]
    return table


def _read(source: Path, mapping: Mapping | None) -> tuple[list[Path], list, bool]:
    """Return the files of a source, its tests, and whether it says that it is synthetic."""
    if not source.exists():
        raise TableError(f"{source}: no such file or folder; name one that exists")
    if source.is_dir():
        if mapping is None:
            return input_files(source), read_material_tests(source), declared_synthetic(source)
        files = [path for path in sorted(source.rglob("*")) if path.is_file()]
        return files, read_mapped_folder(source, mapping), False
    entry = mapping.entry_for(source.name) if mapping else None
    if entry is None:
        raise TableError(
            f"{source}: a single file needs a mapping that says what its columns are; give --mapping"
        )
    return [source], read_mapped(source, entry), False
