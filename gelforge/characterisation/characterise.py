"""The material stage: raw tests, or given parameters, to law.json and curves.csv."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from gelforge.characterisation.common_form import MaterialTest
from gelforge.characterisation.curves import MeanCurve, mean_curves, monotonic_loading, sample_curves
from gelforge.characterisation.fit import WEIGHTS, FitError, LawFit, fit_law
from gelforge.characterisation.law_file import MaterialLaw, write_law
from gelforge.characterisation.material_tests import (
    declared_synthetic,
    input_files,
    read_material_tests,
)
from gelforge.config import Material, OgdenParameters
from gelforge.files import digest, file_sha256, write_text
from gelforge.mechanics.laws import Ogden, PrincipalLaw

CURVE_COLUMNS = [
    "test",
    "sample",
    "stretch",
    "cauchy_stress_kPa",
    "nominal_stress_kPa",
    "model_nominal_stress_kPa",
]
MEAN = "mean"  # the sample name of the averaged curve


def characterise(name: str, material: Material, law_path: str | Path, curves_path: str | Path) -> MaterialLaw:
    """Write law.json and curves.csv of a material and return its law; the same inputs give the same bytes."""
    if material.parameters:
        law, curves = given_law(name, material.parameters), pd.DataFrame(columns=CURVE_COLUMNS)
    else:
        law, curves = fitted_law(name, material.tests, material.ogden_terms)
    write_text(curves_path, curves.to_csv(index=False, float_format="%.10g", lineterminator="\n"))
    write_law(law_path, law)
    return law


def given_law(name: str, parameters: OgdenParameters) -> MaterialLaw:
    """Return the law whose parameters are given; nothing is known of its uncertainty."""
    mu = tuple(m * 1e-3 for m in parameters.mu_kPa)
    return MaterialLaw(
        name, Ogden(mu, tuple(parameters.alpha)), digest({"parameters": parameters.model_dump()})
    )


def fitted_law(name: str, folder: str | Path, terms: int) -> tuple[MaterialLaw, pd.DataFrame]:
    """Return the law fitted to a folder of raw tests, and its curves as a table (CURVE_COLUMNS)."""
    samples, notes = monotonic_loading(read_material_tests(folder))
    means = mean_curves(samples)
    try:
        fit = fit_law(means, f"ogden{terms}")
    except FitError as error:
        raise FitError(f"{folder}: {error}") from None
    law = material_law(name, fit, _inputs_digest(Path(folder), terms), declared_synthetic(folder), notes)
    return law, curve_table(samples, means, fit.law)


def material_law(name: str, fit: LawFit, inputs_digest: str, synthetic: bool, notes=()) -> MaterialLaw:
    """Return what is kept of a fit."""
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


def _inputs_digest(folder: Path, terms: int) -> str:
    files = {path.relative_to(folder).as_posix(): file_sha256(path) for path in input_files(folder)}
    return digest({"files": files, "ogden_terms": terms})
