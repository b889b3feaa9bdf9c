"""Material tests to a fitted constitutive model."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from gelforge.api import arguments
from gelforge.api.printed import with_error
from gelforge.config import ConfigError, Fitting, section_from

if TYPE_CHECKING:
    from gelforge.materials.fitting.law_file import MaterialLaw


@dataclass(frozen=True)
class Fitted:
    """A constitutive model that was fitted to material tests; `gelforge.press(materials={"gel": fitted})` takes it.

    `law` holds the model [MPa], the covariance of its parameters and the range that was tested. A row of `parameters` is
    a parameter of one of the models that were tried, with its 95 % interval; a row of `comparison` is a model.
    """

    law: MaterialLaw
    parameters: pd.DataFrame
    comparison: pd.DataFrame
    effects: pd.DataFrame  # what the tests say of rate, cycles, age, temperature
    warnings: tuple[str, ...]  # what must be known before the model is used

    def __repr__(self) -> str:
        law = self.law
        tests = ", ".join(f"{test} {count}" for test, count in (law.samples or {}).items())
        lines = [
            f"Fitted: {law.family.name}, E = {self.youngs_modulus_kPa:.4g} kPa; {law.material}, specimens: {tests}",
            f"  standard errors from {law.covariance_from}",
        ]
        errors = [None] * len(law.values) if law.covariance is None else np.sqrt(np.diag(law.covariance))
        for name, value, error in zip(law.parameters, law.values, errors):
            unit = "" if law.family.unit(name) == "1" else f" {law.family.unit(name)}"
            number = "0, at its bound" if value == 0 and error == 0 else with_error(value, error) + unit
            lines.append(f"  {name.removesuffix('_kPa')} = {number}")
        if law.r2_nominal:
            lines.append("  R2 " + ", ".join(f"{test} {r2:.4f}" for test, r2 in law.r2_nominal.items()))
        lines += [f"  ! {shorten(text, 160)}" for text in self.warnings]
        return "\n".join(lines)

    @property
    def model(self) -> str:
        """The name of the chosen constitutive model, as `models` takes it."""
        return self.law.family.name

    @property
    def youngs_modulus_kPa(self) -> float:
        """Young's modulus of the undeformed state [kPa]."""
        return self.law.law.youngs_modulus * 1e3

    @property
    def block(self) -> dict[str, Any]:
        """The keys of a study's `materials` that give this model, without its uncertainty."""
        from gelforge.mechanics.laws.models import section_of

        return {"parameters": section_of(self.law.law).model_dump(mode="json")}

    def save(self, path: str | Path) -> None:
        """Write the file that `--laws` of the commands takes.

        Parameters
        ----------
        path : path
            The JSON file to write.
        """
        from gelforge.materials.fitting.law_file import write_law

        write_law(Path(path), self.law)


def fit(
    tests: str | Path,
    *,
    models: Sequence[str] = ("ogden2",),
    mapping: str | Path | None = None,
    choose: str = "aicc",
    loss: str = "linear",
) -> Fitted:
    """Return the constitutive model that describes the tests of one material best, with its uncertainty.

    Parameters
    ----------
    tests : path
        A folder with samples.csv and one CSV per specimen (docs/file-formats.md), or, with a mapping, other files.
    models : sequence of str
        Models to be fitted: neo_hooke, mooney_rivlin, yeoh, gent, ogden1 to ogden4.
    mapping : path, optional
        YAML file that says what files of another form hold (docs/material-mappings.md).
    choose : str
        How one is chosen: aicc (information criterion), held_out (prediction of tests left out) or first.
    loss : str
        linear, or soft_l1, which forgives outliers.

    Returns
    -------
    Fitted
        The chosen model [MPa] with the covariance of its parameters, all models that were tried, and what the tests say of
        rate, cycles, age and temperature.

    Raises
    ------
    ConfigError
        An unknown model or setting, or files that hold several materials.
    FitError
        Tests to which nothing can be fitted; MaterialError names a file, row and value that cannot be read.

    Examples
    --------
    SYNTHETIC tests of the demo, made from the article's parameters (E = 16.9 kPa):

    >>> import gelforge as gf
    >>> from gelforge.shipped import EXAMPLES
    >>> gel = gf.fit(EXAMPLES / "data/demo/materials/ecoflex_gel", models=["neo_hooke", "ogden1"])
    >>> gel.model
    'neo_hooke'
    >>> 15 < gel.youngs_modulus_kPa < 18
    True
    """
    from gelforge.materials.characterise import inputs_of, material_law, parameters_table
    from gelforge.materials.fits import fits_of
    from gelforge.materials.readers.material_source import read_sources

    keys = {"laws": arguments.names("models", models), "choose": choose, "loss": loss}
    fitting = section_from(Fitting, keys, "gelforge.fit")
    folder = arguments.path("tests", tests, "a folder with samples.csv, or of files that a mapping describes")
    declared = None if mapping is None else arguments.path("mapping", mapping, "a mapping's YAML file")
    sources = read_sources([folder], declared)
    if len(sources) != 1:
        names = ", ".join(source.name for source in sources) or "none"
        raise ConfigError(f"{tests}: found tests of {names}, one material is needed; name its folder")
    source = sources[0]
    fits = fits_of(source, fitting)
    comparison = fits.comparison
    assert comparison is not None, "fits_of raises where nothing is fitted"
    for text in comparison.fallback:
        warnings.warn(text, stacklevel=2)
    notes = (*comparison.fallback, *fits.notes)
    law = material_law(
        source.name, comparison.chosen.fitted, inputs_of(source, fitting), source.synthetic, notes
    )
    return Fitted(
        law,
        parameters_table(source.name, fits),
        comparison.table(),
        fits.effects.table(),
        (*comparison.warnings, *fits.notes),
    )
