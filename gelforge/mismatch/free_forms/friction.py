"""The coefficient of friction as a smooth function of the contact pressure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from gelforge.config import Study, changed_study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.mechanics.contact.forces import friction_coefficient
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.kernels import FreeForm, Module
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context, Effect, Hyperparameters, Parameter
from gelforge.mismatch.model.places import FirstOrder

# Of the study's reference pressure: the lowest one makes a power of most pressures, the highest a straight line.
REFERENCES = (0.1, 1.0, 10.0)
WIDTH = 0.2  # of each exponent: together as wide as that of Hertzian asperities, 1/3 (Schallamach 1952)


def grid(study: Study) -> list[Hyperparameters]:
    """Return the reference pressures [MPa] of the factors (1 + p / reference)^-exponent."""
    reference = study.mechanics.effects.contact.reference_pressure_MPa
    return [{"reference_pressure_MPa": share * reference} for share in REFERENCES]


def with_terms(study: Study, exponents: Mapping[float, float]) -> Study:
    """Return the study with more of some exponents by reference pressure [MPa]."""
    terms = [term.model_dump() for term in study.mechanics.effects.contact.pressure_terms]
    more = [{"reference_pressure_MPa": p, "exponent": float(n)} for p, n in exponents.items() if n]
    return with_keys(study, contact={"pressure_terms": [*terms, *more]})


def _to_study(study: Study, hyperparameters: Hyperparameters, theta: Sequence[float]) -> Study:
    (n,) = theta
    return with_terms(study, {float(hyperparameters["reference_pressure_MPa"]): float(n)}) if n else study


TERM = Effect(
    name="friction_term",
    family="contact",
    parameters=(Parameter("exponent", "1", WIDTH, (-0.99, 0.99), "width: see WIDTH; bounds: the study's"),),
    to_study=_to_study,
    to_forces=FirstOrder("friction_term", scanned=grid),
    grid=lambda context: grid(context.study),
    applies=lambda study: study.mechanics.friction > 0,
)


def module(context: Context, changes: Sequence[Candidate]) -> Module | None:
    """Return the change of the coefficient over the pressure; changes: by the exponent at each reference pressure."""
    if len(changes) < len(REFERENCES) or "friction" not in context.derivatives:
        return None
    (excess,) = CATALOGUE["friction"].parameters
    references = [float(one.hyperparameters["reference_pressure_MPa"]) for one in changes]
    everywhere = excess.width * context.observations.flat(context.derivative("friction"))
    shares = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # of the reference pressure: pressures of the map
    pressures = context.study.mechanics.effects.contact.reference_pressure_MPa * shares
    shares_of_law = _share(context.study, pressures)
    falls = -WIDTH * context.study.mechanics.friction * np.log1p(pressures[:, None] / np.array(references))
    basis = shares_of_law[:, None] * np.column_stack([np.full(len(shares), excess.width), falls])
    return Module(
        words="friction at other pressures",
        directions=np.column_stack([everywhere, *(WIDTH * one.columns[:, 0] for one in changes)]),
        name="friction",
        says="friction depends differently on the contact pressure",
        map=pd.DataFrame({"quantity": "coefficient of friction", "pressure_MPa": pressures}),
        basis=basis,
        unit="1",
        of_labels=True,
        where=lambda row: f"at {1e3 * row['pressure_MPa']:.3g} kPa",
        form_of=("friction", "friction_law", "frictionless"),
        to_study=lambda study, change: _with_friction(study, references, basis, change),
    )


def _share(study: Study, pressures: np.ndarray) -> np.ndarray:
    """Return the coefficient (G,) at pressures (G,) [MPa] over mechanics.friction, as the study has it."""
    contact = study.mechanics.effects.contact
    return friction_coefficient(pressures, 1.0, contact.friction_exponents, contact.friction_pressures_MPa)


def _with_friction(study: Study, references: Sequence[float], basis: np.ndarray, change: np.ndarray) -> Study:
    """Return the study with the coefficient and the exponents that make a map (G,), to first order, in a study's bounds."""
    excess, *exponents = np.linalg.lstsq(basis, change, rcond=None)[0]  # exact: the map is made of them
    width = CATALOGUE["friction"].parameters[0].width
    mu = float(np.clip(study.mechanics.friction + width * excess, 0.0, 2.0))  # as a study can have
    study = changed_study(study, {"mechanics": {"friction": mu}})
    (most,) = TERM.parameters[0].bounds[1:]
    return with_terms(study, {p: np.clip(WIDTH * n, -most, most) for p, n in zip(references, exponents)})


FREE_FORM = FreeForm("friction", module, derivatives=(TERM,))
