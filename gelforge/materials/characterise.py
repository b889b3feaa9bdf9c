"""The material stage: what was measured, or given parameters, to one folder of results per material.

| file | what |
|---|---|
| law.json | the chosen law; laws/<name>.json: each other one that the tests determine |
| laws.csv, .md | the laws compared: information criterion, errors of prediction, stability |
| parameters.csv, .md | parameters of all laws with intervals |
| curves.csv | samples, their mean and the chosen law: what the figure shows |
| effects.json, .csv, .md | rate, holds, cycles, age, temperature, small tests: sizes, intervals, sentences |
| notes.txt | the summary |
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import Fitting, Material, given
from gelforge.files import digest, file_sha256, write_json, write_product_table, write_table, write_text
from gelforge.materials.basis.common_form import MaterialTest
from gelforge.materials.basis.measured_effects import MeasuredEffects
from gelforge.materials.fits import Fits, fits_of
from gelforge.materials.fitting.bootstrap import bootstrap as bootstrap_samples
from gelforge.materials.fitting.choice import Comparison
from gelforge.materials.fitting.curves import MeanCurve, sample_curves
from gelforge.materials.fitting.fit import WEIGHTS, FitError, LawFit
from gelforge.materials.fitting.law_file import MaterialLaw, read_law, rounded, write_law
from gelforge.materials.fitting.material_table import material_table
from gelforge.materials.fitting.stiffness import check_stiffness
from gelforge.materials.readers.material_source import MaterialSource, source_of
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.parameters import GivenParameters

CURVE_COLUMNS = "test sample stretch cauchy_stress_kPa nominal_stress_kPa model_nominal_stress_kPa".split()
MEAN = "mean"  # the sample name of the averaged curve
NOTHING_MEASURED = "the constitutive model was given, or read from a file; no test was fitted"


@dataclass(frozen=True)
class Characterised:
    """What was found for one material, and the law files written next to the chosen one."""

    name: str
    comparison: Comparison | None  # None: no test that a law can be fitted to
    effects: MeasuredEffects
    notes: tuple[str, ...]
    other_laws: tuple[Path, ...] = ()

    @property
    def summary(self) -> str:
        """Return in a few lines which law was chosen, why, what to beware of, and the effects' sentences."""
        lines: list[str] = [f"{self.name}: no constitutive model is fitted"]
        warnings: list[str] = []
        if self.comparison:
            fit, warnings = self.comparison.chosen.fitted, self.comparison.warnings
            lines = [
                f"{self.name}: {self.comparison.reason}",
                f"  E = {fit.law.youngs_modulus * 1e3:.4g} kPa; R2 of the nominal stress: "
                + ", ".join(f"{test} {r2:.4f}" for test, r2 in fit.r2_nominal.items()),
            ]
        lines += [f"  ! {text}" for text in (*warnings, *self.notes)]
        lines += [f"  {e.effect}, {e.test}: {e.sentence}" for e in self.effects.effects]
        lines += [f"  {effect}: not judged, {why}" for effect, why in self.effects.not_judged]
        return "\n".join(lines)


def characterise(name: str, material: Material, folder: Path, study: str = "") -> None:
    """Write the results of a study's material; the same inputs give the same bytes.

    Parameters
    ----------
    name : str
        Of the material.
    material : Material
        Tests, given parameters or a law's file.
    folder : Path
        Receives the files that the module's table lists.
    study : str
        Name of the study, which the laws state.

    Raises
    ------
    FitError
        For tests to which no constitutive model can be fitted.
    ConfigError
        For a stiffness that is neither plausible nor confirmed.
    LawFileError
        For a law's file that cannot be read.
    """
    if material.tests is not None:
        try:
            source = replace(source_of(name, material.tests, material.mapping), study=study)
            characterise_source(source, material, folder)
        except FitError as error:
            raise FitError(f"{material.tests}: {error}") from None
        check_stiffness(read_law(folder / "law.json"), material.stiffness_confirmed)
        return
    law = known_law(name, material)
    check_stiffness(law, material.stiffness_confirmed)
    effects = MeasuredEffects(name, (), ())
    _clear(folder)
    _write_effects(folder, effects, law.inputs_digest, False)
    write_table(folder, "parameters", material_table([law]))
    write_table(folder, "laws", pd.DataFrame(columns=["law", "chosen"]))
    _write_curves(folder, pd.DataFrame(columns=CURVE_COLUMNS))
    write_text(folder / "notes.txt", f"{name}: {NOTHING_MEASURED}\n")
    write_law(folder / "law.json", replace(law, study=study))


def known_law(name: str, material: Material) -> MaterialLaw:
    """Return the law of a material without tests: of its file, or with given parameters.

    Parameters
    ----------
    name : str
        Of the material.
    material : Material
        With `file` or `parameters`.

    Returns
    -------
    MaterialLaw
        Moduli in MPa.

    Raises
    ------
    LawFileError
        For a file that cannot be read.
    """
    if material.file is not None:
        return replace(read_law(material.file), material=name)
    return given_law(name, given(material.parameters, "parameters"))


def given_law(name: str, parameters: GivenParameters) -> MaterialLaw:
    """Return the law whose parameters are given; nothing is known of its uncertainty."""
    law = parameters.constitutive_model()
    return MaterialLaw(name, law, digest({"parameters": parameters.model_dump()}))


def characterise_source(
    source: MaterialSource, fitting: Fitting, folder: Path, workers: int = 1, law_needed: bool = True
) -> Characterised:
    """Write the results of a material into a folder and return them.

    Parameters
    ----------
    source : MaterialSource
        Tests of the material.
    fitting : Fitting
        Which laws are fitted, and how.
    folder : Path
        As of `characterise`.
    workers : int
        Processes of the bootstrap.
    law_needed : bool
        Refuse tests to which no law can be fitted; otherwise only the effects are written then.

    Returns
    -------
    Characterised
        Comparison of the laws, effects and notes.

    Raises
    ------
    FitError
        Where a law is needed and no test can be fitted, or a fit fails.
    """
    fits = fits_of(source, fitting, law_needed)
    inputs = inputs_of(source, fitting)
    _clear(folder)
    others = []
    if fits.comparison:
        others = _write_laws(folder, source, fits.comparison, list(fits.notes), inputs)
        _write_curves(folder, curve_table(fits.tests, fits.curves, fits.comparison.chosen.fitted.law))
        write_table(folder, "laws", fits.comparison.table())
        write_table(folder, "parameters", parameters_table(source.name, fits, fitting.bootstrap, workers))
    _write_effects(folder, fits.effects, inputs, source.synthetic)
    result = Characterised(source.name, fits.comparison, fits.effects, fits.notes, tuple(others))
    write_text(folder / "notes.txt", result.summary + "\n")
    return result


def inputs_of(source: MaterialSource, fitting: Fitting) -> str:
    """Return the digest of what decides a material's fits: its files and how they are fitted.

    Parameters
    ----------
    source : MaterialSource
        Its files.
    fitting : Fitting
        Its keys that decide a fit.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    files = sorted((path.name, file_sha256(path)) for path in source.files)
    return digest({"files": files, "fitting": fitting.fitting_keys()})


def material_law(name: str, fit: LawFit, inputs_digest: str, synthetic: bool, notes=()) -> MaterialLaw:
    """Return what is kept of a fit.

    Parameters
    ----------
    name : str
        Of the material.
    fit : LawFit
        Fitted law with its covariance and ranges.
    inputs_digest : str
        As of `inputs_of`.
    synthetic : bool
        The tests come from a virtual lab.
    notes : sequence of str
        In front of the fit's own.

    Returns
    -------
    MaterialLaw
        As `write_law` stores it.
    """
    return MaterialLaw(
        name,
        fit.law,
        inputs_digest,
        fit.covariance,
        fit.r2_nominal,
        fit.valid_stretch,
        fit.samples,
        synthetic,
        freedom=fit.freedom,
        covariance_from=fit.covariance_from,
        valid_states=fit.valid.extremes,
        unstable_from=fit.unstable_from,
        fitted_by=f"{WEIGHTS}; {fit.loss} loss",
        notes=(*notes, *fit.notes),
    )


def curve_table(samples: list[MaterialTest], means: list[MeanCurve], law: PrincipalLaw) -> pd.DataFrame:
    """Return measured, averaged and modelled stress [kPa] against stretch; sample "mean" is the average."""
    curves = [(c, sample.sample) for sample in samples for c in sample_curves(sample)]
    curves += [(c, MEAN) for c in means]
    parts = []
    for c, sample in curves:
        model = c.points.measured_stress(law)
        content = (c.label, sample, c.stretch, c.cauchy_stress * 1e3, c.nominal_stress * 1e3, model * 1e3)
        parts.append(pd.DataFrame(dict(zip(CURVE_COLUMNS, content))))
    return pd.concat(parts, ignore_index=True)


def parameters_table(name: str, fits: Fits, bootstrap: int = 0, workers: int = 1) -> pd.DataFrame:
    """Return the parameters of all fitted laws with their 95 % intervals.

    Parameters
    ----------
    name : str
        Of the material.
    fits : Fits
        With a comparison.
    bootstrap : int
        Refits over samples for further intervals of the chosen law; 0 for none.
    workers : int
        Processes of the bootstrap.

    Returns
    -------
    pandas.DataFrame
        Rows as of `material_table`, with columns `law` and `chosen`.
    """
    comparison = fits.comparison
    assert comparison is not None, "the caller has checked that something was fitted"
    tables = []
    for candidate in (c for c in comparison.candidates if c.fit):
        table = material_table([material_law(name, candidate.fitted, "", False)])
        tables.append(table.assign(law=candidate.name, chosen=candidate is comparison.chosen))
    table = pd.concat(tables, ignore_index=True)
    if bootstrap:
        return with_bootstrap(table, fits.curves, comparison.chosen.fitted, bootstrap, workers)
    return table


def with_bootstrap(
    table: pd.DataFrame, curves: list[MeanCurve], fit: LawFit, replicates: int, workers: int
) -> pd.DataFrame:
    """Return the table with the bootstrap's 95 % intervals of the fitted law's parameters and modulus added."""
    # the seed: the same files give the same intervals
    drawn = bootstrap_samples(curves, fit, replicates, 20191113, workers)
    moduli = np.array([fit.family.law(theta).youngs_modulus * 1e3 for theta in drawn.theta])
    names = [name.removesuffix("_kPa") for name in fit.family.parameters]
    ends = {
        name: drawn.interval(values) for name, values in zip([*names, "E"], [*drawn.parameters.T, moduli])
    }
    mine = table.law == fit.family.name
    for column, end in (("low_95_bootstrap", 0), ("high_95_bootstrap", 1)):
        table[column] = [ends[q][end] if m and q in ends else np.nan for q, m in zip(table.quantity, mine)]
    return table


def _clear(folder: Path) -> None:
    """Remove the laws of an earlier run; the folder of other laws is there even when it stays empty."""
    (folder / "laws").mkdir(parents=True, exist_ok=True)
    for path in (folder / "laws").glob("*.json"):
        path.unlink()


def _write_laws(
    folder: Path, source: MaterialSource, comparison: Comparison, notes: list[str], inputs: str
) -> list[Path]:
    """Write the chosen law and the others; return the files of the others."""
    others = []
    for candidate in (c for c in comparison.candidates if c.fit):
        chosen = candidate is comparison.chosen
        path = folder / ("law.json" if chosen else f"laws/{candidate.name}.json")
        kept = notes
        if chosen:
            kept = [*comparison.fallback, *notes, *comparison.misfit, *comparison.identifiability]
        law = material_law(source.name, candidate.fitted, inputs, source.synthetic, kept)
        write_law(path, replace(law, study=source.study))
        others += [] if chosen else [path]
    return others


def _write_curves(folder: Path, table: pd.DataFrame) -> None:
    write_product_table(folder / "curves.csv", table, "%.10g")


def _write_effects(folder: Path, effects: MeasuredEffects, inputs_digest: str, synthetic: bool) -> None:
    write_json(folder / "effects.json", rounded(effects.content(inputs_digest, synthetic)))
    write_table(folder, "effects", effects.table())
