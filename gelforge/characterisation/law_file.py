"""The file of a material's law: law.json, the same bytes for the same inputs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.files import write_json
from gelforge.mechanics.laws import Ogden

FORMAT = "gelforge-law-1"
CONVENTION = (
    "W = sum_k mu_k/alpha_k (l1^alpha_k + l2^alpha_k + l3^alpha_k - 3), l1 l2 l3 = 1;"
    " E = 1.5 sum_k mu_k alpha_k"
)
DIGITS = 10  # of every stored number: beyond the convergence of a fit, within what another machine reproduces


class LawFileError(ValueError):
    """A law file that cannot be used: which, what was found, what to do."""


@dataclass(frozen=True)
class MaterialLaw:
    """The law of one material [MPa] and where it comes from.

    covariance (2K, 2K) is that of (mu_1_kPa, alpha_1, mu_2_kPa, ...); it, r2_nominal and valid_stretch are
    None and samples is empty for a law that was given rather than fitted.
    """

    material: str
    law: Ogden
    inputs_digest: str
    covariance: np.ndarray | None = None
    r2_nominal: dict[str, float] | None = None
    valid_stretch: dict[str, tuple[float, float]] | None = None
    samples: dict[str, int] | None = None
    synthetic: bool = False  # the tests come from a virtual lab

    @property
    def parameters(self) -> list[str]:
        """Return the names of the parameters in the order of the covariance."""
        return [name for k in range(1, len(self.law.mu) + 1) for name in (f"mu_{k}_kPa", f"alpha_{k}")]


def write_law(path: str | Path, material: MaterialLaw) -> None:
    """Write law.json, whole or not at all."""
    law, covariance = material.law, material.covariance
    content = {
        "format": FORMAT,
        "material": material.material,
        "law": "ogden",
        "convention": CONVENTION,
        "mu_kPa": [m * 1e3 for m in law.mu],
        "alpha": list(law.alpha),
        "shear_modulus_kPa": law.shear_modulus * 1e3,
        "youngs_modulus_kPa": law.youngs_modulus * 1e3,
        "covariance": None
        if covariance is None
        else {"parameters": material.parameters, "matrix": np.asarray(covariance).tolist()},
        "r2_nominal": material.r2_nominal,
        "valid_stretch": material.valid_stretch,
        "samples": material.samples or {},
        "synthetic": material.synthetic,
        "inputs_digest": material.inputs_digest,
    }
    write_json(path, _rounded(content))


def read_law(path: str | Path) -> MaterialLaw:
    """Return the law of a law.json.

    Raises LawFileError naming the file for one that is missing, damaged or of another format.
    """
    path = Path(path)
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise LawFileError(f"{path}: no such file; run the material stage (snakemake {path})") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise LawFileError(
            f"{path}: not valid JSON ({error}); delete it and run the material stage again"
        ) from None
    found = content.get("format") if isinstance(content, dict) else type(content).__name__
    if found != FORMAT:
        raise LawFileError(f"{path}: format {found!r}, expected {FORMAT!r}; run the material stage again")
    if content.get("law") != "ogden":
        raise LawFileError(f"{path}: law {content.get('law')!r}; 'ogden' is the law that can be read")
    try:
        law = Ogden(tuple(m / 1e3 for m in content["mu_kPa"]), tuple(content["alpha"]))
        covariance, valid = content["covariance"], content["valid_stretch"]
        return MaterialLaw(
            content["material"],
            law,
            content["inputs_digest"],
            None if covariance is None else np.array(covariance["matrix"], dtype=float),
            content["r2_nominal"],
            None if valid is None else {test: (low, high) for test, (low, high) in valid.items()},
            content["samples"],
            content["synthetic"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise LawFileError(
            f"{path}: {type(error).__name__} {error}; delete it and run the material stage again"
        ) from None


def _rounded(content):
    """Return the content with every float rounded to DIGITS significant digits."""
    if isinstance(content, float):
        return float(f"{content:.{DIGITS}g}")
    if isinstance(content, dict):
        return {key: _rounded(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_rounded(value) for value in content]
    return content
