"""The material stage: raw tests, or given parameters, to law.json and curves.csv."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.characterisation.curves import MeanCurve, mean_curves
from gelforge.characterisation.fit import FitError, fit_ogden
from gelforge.characterisation.law_file import MaterialLaw, write_law
from gelforge.characterisation.material_tests import (
    SampleCurve,
    declared_synthetic,
    input_files,
    read_material_tests,
)
from gelforge.config import Material, OgdenParameters
from gelforge.files import digest, file_sha256, write_text
from gelforge.mechanics.homogeneous import nominal_stress
from gelforge.mechanics.laws import Ogden

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
    samples = read_material_tests(folder)
    means = mean_curves(samples)
    try:
        fit = fit_ogden(means, terms)
    except FitError as error:
        raise FitError(f"{folder}: {error}") from None
    covariance = fit.covariance * _kPa_factors(terms)
    law = MaterialLaw(
        name,
        fit.law,
        _inputs_digest(Path(folder), terms),
        covariance,
        fit.r2_nominal,
        fit.valid_stretch,
        fit.samples,
        declared_synthetic(folder),
    )
    return law, curve_table(samples, means, fit.law)


def curve_table(samples: list[SampleCurve], means: list[MeanCurve], law: Ogden) -> pd.DataFrame:
    """Return measured, averaged and modelled stress [kPa] against stretch; sample "mean" is the average."""
    curves = [(c.test, c.sample, c.stretch, c.nominal_stress) for c in samples]
    curves += [(c.test, MEAN, c.stretch, c.nominal_stress) for c in means]
    parts = []
    for test, sample, stretch, nominal in curves:
        model = nominal_stress(law, test, stretch)
        content = (test, sample, stretch, nominal * stretch * 1e3, nominal * 1e3, model * 1e3)
        parts.append(pd.DataFrame(dict(zip(CURVE_COLUMNS, content))))
    return pd.concat(parts, ignore_index=True)


def _kPa_factors(terms: int) -> np.ndarray:
    """Return the factors (2K, 2K) from the covariance of (mu_1 [MPa], alpha_1, ...) to (mu_1 [kPa], ...)."""
    scale = np.array([1e3, 1.0] * terms)
    return np.outer(scale, scale)


def _inputs_digest(folder: Path, terms: int) -> str:
    files = {path.name: file_sha256(path) for path in input_files(folder)}
    return digest({"files": files, "ogden_terms": terms})
