"""The file of a material's law: law.json, the same bytes for the same inputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.files import read_product_json, write_product_json
from gelforge.materials.fitting.valid_range import ValidRange
from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, principal_stretches
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models import MODELS, family_of, parameters_of

FORMAT = "gelforge-law-1"
# As an indentation strains gel and skin, and half as far again.
STATES = np.concatenate(
    [
        principal_stretches(test, np.array([1.03, 1.1, 1.2, 1.4]))
        for test in ("uniaxial", "pure_shear", "equibiaxial")
    ]
)
NEGLIGIBLE = 1e-3  # of the variance: the error bar is then short by less than a thousandth
DIGITS = 10  # of every stored number: beyond the convergence of a fit, within what another machine reproduces


class LawFileError(ValueError):
    """A law file that cannot be used: which, what was found, what to do."""


@dataclass(frozen=True)
class MaterialLaw:
    """The law of one material [MPa] and where it comes from.

    covariance (p, p) is that of the parameters in the units of the file (`parameters`); what describes a fit is None
    or empty for a law that was given rather than fitted.
    """

    material: str
    law: PrincipalLaw
    inputs_digest: str
    covariance: np.ndarray | None = None
    r2_nominal: dict[str, float] | None = None
    valid_stretch: dict[str, tuple[float, float]] | None = None
    samples: dict[str, int] | None = None
    synthetic: bool = False  # the tests come from a virtual lab
    freedom: int | None = None  # degrees of freedom of the covariance
    covariance_from: str | None = None  # what was taken as independent
    valid_states: np.ndarray | None = None  # (m, 3) outermost tested stretches, largest first
    unstable_from: float | None = None  # share of the tested range, None where Drucker-stable
    fitted_by: str | None = None  # weights and loss
    notes: tuple[str, ...] = ()
    study: str = ""  # for which it was made; empty: by hand, for any

    @property
    def family(self) -> Family:
        """Return the family of the law."""
        return family_of(self.law)

    @property
    def parameters(self) -> list[str]:
        """Return the names of the parameters in the order of the covariance."""
        return list(self.family.parameters)

    @property
    def values(self) -> np.ndarray:
        """Return the parameters (p,) in the units of the file."""
        return parameters_of(self.law)

    @property
    def valid_range(self) -> ValidRange | None:
        """Return the range of stretch in which the law was tested; None where nothing is known of it."""
        states = self.valid_states
        if states is None and self.valid_stretch:
            ends = [(t, v) for t, v in self.valid_stretch.items() if t in LOAD_CASES]
            states = (
                np.concatenate([principal_stretches(test, np.array(v)) for test, v in ends]) if ends else None
            )
        return None if states is None else ValidRange.of(states)


def moved_laws(material: MaterialLaw, amount: float) -> list[PrincipalLaw]:
    """Return the law moved by `amount` standard deviations along independent directions of its parameters.

    The squares of what a small move changes, over amount, sum to the variance of anything that follows from the law.
    Directions are those of the stresses at STATES, the most uncertain first; along the others parameters make up for
    each other, and what they leave of the stresses' variance, less than NEGLIGIBLE, is left out. Empty for a law that was
    given: nothing is known of its uncertainty.
    """
    if material.covariance is None:
        return []
    scale = np.abs(material.values)  # parameters have units of their own
    variance, directions = np.linalg.eigh(material.covariance / np.outer(scale, scale))
    moves = (directions * np.sqrt(np.maximum(variance, 0.0))).T * scale  # (p, p), one in each row
    plain = _stresses(material.law)
    changes = np.array([_stresses(_moved(material, amount * move)) / plain - 1 for move in moves]) / amount
    turn, sizes, _ = np.linalg.svd(changes, full_matrices=False)
    kept = sizes**2 > NEGLIGIBLE * (sizes**2).sum()
    return [_moved(material, amount * move) for move in turn.T[kept] @ moves]


def _stresses(law: PrincipalLaw) -> np.ndarray:
    """Return the Cauchy stresses of a law at STATES, n numbers."""
    beta = law.principal_stress(STATES)
    return beta[:, 0] - beta[:, 2]


def _moved(material: MaterialLaw, move: np.ndarray) -> PrincipalLaw:
    try:
        return material.family.law_of(material.values + move)
    except ValueError as error:
        raise LawFileError(
            f"{material.material}: the covariance of its constitutive model reaches parameters that are not"
            f" possible ({error}); repeat the tests"
            " or choose a constitutive model with fewer parameters"
        ) from None


def leaves_valid_range(material: MaterialLaw, lam: np.ndarray) -> np.ndarray | None:
    """Return whether deformations with principal stretches lam (..., 3), in any order, leave the tested range.

    Changes of volume do not count. None where the law was given and nothing is known of its range.
    """
    valid = material.valid_range
    return None if valid is None else valid.outside(lam)


def write_law(path: str | Path, material: MaterialLaw) -> None:
    """Write law.json, whole or not at all."""
    law, covariance, family = material.law, material.covariance, material.family
    content = {
        "format": FORMAT,
        "material": material.material,
        "law": law.name,
        "convention": MODELS[law.name].formula,
        "parameters": [
            {"name": name, "unit": family.unit(name), "value": float(value)}
            for name, value in zip(family.parameters, material.values)
        ],
        "shear_modulus_kPa": law.shear_modulus * 1e3,
        "youngs_modulus_kPa": law.youngs_modulus * 1e3,
        "covariance": None
        if covariance is None
        else {
            "parameters": material.parameters,
            "matrix": np.asarray(covariance).tolist(),
            "freedom": material.freedom,
            "from": material.covariance_from,
        },
        "r2_nominal": material.r2_nominal,
        "valid_stretch": material.valid_stretch,
        "valid_states": None if material.valid_states is None else np.asarray(material.valid_states).tolist(),
        "unstable_from": material.unstable_from,
        "fitted_by": material.fitted_by,
        "notes": list(material.notes),
        "samples": material.samples or {},
        "synthetic": material.synthetic,
        "inputs_digest": material.inputs_digest,
        "study": material.study,
    }
    write_product_json(path, rounded(content | law.file_keys()))


def read_law(path: str | Path) -> MaterialLaw:
    """Return the law of a law.json.

    Raises LawFileError naming the file for one that is missing, damaged or of another format.
    """
    path = Path(path)
    remedy = f"run the material stage again (snakemake -R {path})"
    content = read_product_json(path, remedy, LawFileError)
    found = content.get("format")
    if found != FORMAT:
        raise LawFileError(f"{path}: format {found!r}, expected {FORMAT!r}; {remedy}")
    kind = content.get("law")
    if kind not in MODELS:
        raise LawFileError(f"{path}: constitutive model {kind!r}; one of {list(MODELS)} can be read")
    try:
        covariance, valid = content["covariance"], content["valid_stretch"]
        states = content.get("valid_states")
        return MaterialLaw(
            content["material"],
            MODELS[kind].of_file(content),
            content["inputs_digest"],
            None if covariance is None else np.array(covariance["matrix"], dtype=float),
            content["r2_nominal"],
            None if valid is None else {test: (low, high) for test, (low, high) in valid.items()},
            content["samples"],
            content["synthetic"],
            (covariance or {}).get("freedom"),
            (covariance or {}).get("from"),
            None if states is None else np.array(states, dtype=float),
            content.get("unstable_from"),
            content.get("fitted_by"),
            tuple(content.get("notes", ())),
            content.get("study", ""),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise LawFileError(f"{path}: {type(error).__name__} {error}; {remedy}") from None


def rounded(content):
    """Return JSON-able content with every float rounded to DIGITS significant digits, null where it is not finite."""
    if isinstance(content, float):
        return float(f"{content:.{DIGITS}g}") if np.isfinite(content) else None
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [rounded(value) for value in content]
    return content
