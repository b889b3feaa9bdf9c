"""The file of a material's law: law.json, the same bytes for the same inputs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.files import read_product_json, write_product_json
from gelforge.materials.fitting.valid_range import ValidRange
from gelforge.mechanics.laws.family import Family
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, StressPoints, principal_stretches
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models import MODELS, family_of, parameters_of

FORMAT = "gelforge-law-1"
# As an indentation strains gel and skin, and half as far again.
STRETCHES = np.array([1.03, 1.1, 1.2, 1.4])
STATES = np.concatenate(
    [principal_stretches(case, STRETCHES) for case in ("uniaxial", "pure_shear", "equibiaxial")]
)
NEGLIGIBLE = 1e-3  # of the variance: the error bar is then short by 1 - sqrt(1 - 1e-3) = 5e-4 of itself
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
            parts = [principal_stretches(test, np.array(v)) for test, v in ends]
            states = np.concatenate(parts) if parts else None
        return None if states is None else ValidRange.of(states)


def moved_laws(material: MaterialLaw, amount: float) -> list[PrincipalLaw]:
    """Return the law moved by some standard deviations along independent directions of its parameters.

    The squares of what a small move changes, over amount, sum to the variance of anything that follows from the law.
    Directions are those of the stresses at STATES, the most uncertain first; along the others parameters make up for
    each other, and what they leave of the stresses' variance, less than NEGLIGIBLE, is left out.

    Parameters
    ----------
    material : MaterialLaw
        Its covariance may be of any rank.
    amount : float
        Standard deviations [-].

    Returns
    -------
    list of PrincipalLaw
        One for each direction. Empty for a zero covariance, and for a law that was given: its uncertainty is not known.
    """
    if material.covariance is None:
        return []
    variance = np.diag(material.covariance)
    uncertain = np.flatnonzero(variance > 0)  # a parameter at its bound has neither variance nor correlations
    sigma = np.sqrt(variance[uncertain])
    correlation = material.covariance[np.ix_(uncertain, uncertain)] / np.outer(sigma, sigma)
    size, directions = np.linalg.eigh(correlation)
    moves = np.zeros((len(uncertain), len(material.values)))  # one in each row
    moves[:, uncertain] = (directions * np.sqrt(np.maximum(size, 0.0))).T * sigma
    plain = _stresses(material.law)
    steps = (_moved(material, move, amount) for move in moves)
    moved = [(_stresses(law) / plain - 1) / step for law, step in steps]
    changes = np.reshape(moved, (len(moves), len(plain)))
    changes = changes[:, np.isfinite(changes).all(axis=0)]  # within the limiting stretch of all
    turn, sizes, _ = np.linalg.svd(changes, full_matrices=False)
    kept = sizes**2 > NEGLIGIBLE * (sizes**2).sum()
    return [_moved(material, move, amount)[0] for move in turn.T[kept] @ moves]


def _stresses(law: PrincipalLaw) -> np.ndarray:
    """Return the Cauchy stresses of a law at STATES, n numbers, NaN beyond its limiting stretch."""
    return StressPoints(STATES, np.ones(len(STATES))).measured_stress(law)


def _moved(material: MaterialLaw, move: np.ndarray, amount: float) -> tuple[PrincipalLaw, float]:
    """Return the law moved by amount, and amount; by -amount where the parameters may go that way only."""
    for step in (amount, -amount):
        try:
            return material.family.law_of(material.values + step * move), step
        except ValueError as error:
            reason = error
    raise LawFileError(
        f"{material.material}: the covariance of its constitutive model reaches parameters that are not"
        f" possible ({reason}); repeat the tests or choose a constitutive model with fewer parameters"
    )


def write_law(path: str | Path, material: MaterialLaw) -> None:
    """Write law.json, whole or not at all.

    Parameters
    ----------
    path : str or Path
        The file.
    material : MaterialLaw
        Model [MPa], covariance, tested range and notes.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
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

    Parameters
    ----------
    path : path
        A file that write_law has written.

    Returns
    -------
    MaterialLaw
        Moduli in MPa.

    Raises
    ------
    LawFileError
        A file that is missing, damaged or of another format, by name, with the remedy.
    """
    path = Path(path)
    remedy = f"run the material stage again (snakemake -R {path})"
    content = read_product_json(path, remedy, LawFileError)
    stated = content.get("format")
    if stated != FORMAT:
        raise LawFileError(f"{path}: format {stated!r}, expected {FORMAT!r}; {remedy}")
    kind = content.get("law")
    if kind not in MODELS:
        raise LawFileError(f"{path}: unknown constitutive model {kind!r}; known are {list(MODELS)}")
    try:
        covariance, valid = content["covariance"], content["valid_stretch"]
        states = content.get("valid_states")
        return MaterialLaw(
            content["material"],
            MODELS[kind].of_file(content),
            content["inputs_digest"],
            None if covariance is None else _covariance(covariance),
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


def _covariance(content: dict) -> np.ndarray:
    """Return the covariance (p, p) in a law.json, of any rank. Raises ValueError for what cannot be one."""
    C, p = np.array(content["matrix"], dtype=float), len(content["parameters"])
    if C.shape != (p, p) or not np.isfinite(C).all() or (np.diag(C) < 0).any():
        raise ValueError(
            f"covariance {C.tolist()}; {p} x {p} finite numbers are needed, variances of 0 or more"
        )
    return C


def rounded(content):
    """Return JSON-able content with every float rounded to DIGITS significant digits, null where it is not finite."""
    if isinstance(content, float):
        return float(f"{content:.{DIGITS}g}") if np.isfinite(content) else None
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [rounded(value) for value in content]
    return content
