"""What is known of a parameter before the presses: a Shore hardness, a range, or a factor about the study's value."""

from __future__ import annotations

import re
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from gelforge.config import ConfigError

NINETY = round(NormalDist().inv_cdf(0.95), 4)  # standard deviations to either side that hold 90 %
HARDNESS_FACTOR = 2.0  # by which 90 % of moduli differ from what their hardness says (judgement)
HARDNESS = re.compile(r"shore\s*(a|00|oo)\s*:\s*([0-9.]+)", re.IGNORECASE)
SOURCES = {
    "a": "Gent 1958, doi:10.5254/1.3542351",
    "00": "sphere and spring of ASTM D2240, type OO, by Hertz, as Mix and Giacomin 2011, doi:10.1520/JTE103205",
}


@dataclass(frozen=True)
class Prior:
    """A range that holds a parameter with probability 0.9: normal, of a logarithm where the parameter has one."""

    low: float  # in the parameter's unit
    high: float
    source: str

    def normal(self, logarithmic: bool) -> tuple[float, float]:
        """Return mean and standard deviation of the value, or of its logarithm."""
        low, high = (np.log(self.low), np.log(self.high)) if logarithmic else (self.low, self.high)
        return float(low + high) / 2, float(high - low) / (2 * NINETY)


def youngs_modulus_kPa(scale: str, hardness: float) -> float:
    """Return the Young's modulus [kPa] of an incompressible rubber by its Shore hardness on scale `a` or `00`.

    A is Gent's relation. On scale 00 a ball of radius 1.19 mm is pressed by 0.203 + 0.00908 S [N] and stands
    2.5 (1 - S / 100) [mm] deep.
    """
    if not 0 < hardness < 100:
        raise ConfigError(f"Shore hardness {hardness:g}; more than 0 and less than 100 is needed")
    if scale == "a":
        return 1e3 * 0.0981 * (56 + 7.62336 * hardness) / (0.137505 * (254 - 2.54 * hardness))
    force, depth, radius = 0.203 + 0.00908 * hardness, 2.5 * (1 - hardness / 100), 1.19
    return 1e3 * 0.75 * (1 - 0.5**2) * force / (radius**0.5 * depth**1.5)


def prior_of(name: str, text: str) -> Prior:
    """Return the prior that a text describes.

    Parameters
    ----------
    name : str
        The parameter, for messages; a hardness is for a modulus only.
    text : str
        "shoreA:10", "shore00:30" or "LOW:HIGH", the ends of a 90 % interval.

    Returns
    -------
    Prior
        Ends and source.

    Raises
    ------
    ConfigError
        For another text.
    """
    if hardness := HARDNESS.fullmatch(text.strip()):
        scale = hardness[1].lower().replace("o", "0")
        if not name.endswith(".modulus"):
            raise ConfigError(f"--prior {name}={text}: a hardness says something of a modulus; give LOW:HIGH")
        E = youngs_modulus_kPa(scale, float(hardness[2]))
        return Prior(E / HARDNESS_FACTOR, E * HARDNESS_FACTOR, f"Shore {text}, {SOURCES[scale]}")
    try:
        low, high = (float(part) for part in text.split(":"))
    except ValueError:
        raise ConfigError(f"--prior {name}={text}: write LOW:HIGH, shoreA:10 or shore00:30") from None
    if not low < high:
        raise ConfigError(f"--prior {name}={text}: the lower end comes first")
    return Prior(low, high, "given range")
