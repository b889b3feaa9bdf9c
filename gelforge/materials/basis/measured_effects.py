"""What the tests of a material say about each effect that a quasi-static law leaves out: the priors of later stages.

One entry per effect and kind of test: a number with its interval, a verdict, and the sentence that a paper writes. What
could not be judged is named with its reason: no test of it is no proof of its absence.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field

import pandas as pd

# effect -> the names in the catalogue of missing physics that it is about
INFORMS = {
    "strain_rate": ("viscoelastic",),
    "relaxation": ("viscoelastic",),
    "hysteresis": ("viscoelastic", "mullins"),
    "softening": ("mullins",),
    "ogden_roxburgh": ("mullins",),
    "age": ("ageing",),
    "treatment": ("ageing",),
    "temperature": ("temperature",),
    "lateral_contraction": ("compressibility",),
    "friction": ("friction",),
    "microindentation": ("skin_stiffness", "elastic_base"),
    "adhesion": ("adhesion",),
    "sheet_thickness": ("layer_thickness",),
    "load_cell_gain": ("force_gain",),
}
FORMAT = "gelforge-effects-1"
COLUMNS = "effect test quantity value low_95 high_95 unit verdict interval_from sentence".split()


@dataclass(frozen=True)
class MeasuredEffect:
    """An effect's size with its 95 % interval, where the interval comes from, the verdict and the sentence."""

    effect: str  # a key of INFORMS
    test: str
    quantity: str  # what the value is
    value: float
    interval: tuple[float, float] | None
    interval_from: str
    unit: str
    verdict: str
    sentence: str
    samples: tuple[str, ...] = ()
    parameters: dict = field(default_factory=dict)  # further numbers, units in the names


@dataclass(frozen=True)
class MeasuredEffects:
    """All effects of a material, and why others could not be judged."""

    material: str
    effects: tuple[MeasuredEffect, ...]
    not_judged: tuple[tuple[str, str], ...]  # effect and reason

    def content(self, inputs_digest: str, synthetic: bool) -> dict:
        """Return the content of effects.json."""
        return {
            "format": FORMAT,
            "material": self.material,
            "synthetic": synthetic,
            "inputs_digest": inputs_digest,
            "effects": [_entry(effect) for effect in self.effects],
            "not_judged": [{"effect": effect, "reason": reason} for effect, reason in self.not_judged],
        }

    def table(self) -> pd.DataFrame:
        """Return one row per effect (COLUMNS); what was not judged stands below with its reason as the sentence."""
        nan = float("nan")
        rows = [
            (e.effect, e.test, e.quantity, e.value, *(e.interval or (nan, nan)), e.unit, e.verdict, e.interval_from,
             e.sentence)
            for e in self.effects
        ]  # fmt: skip
        rows += [
            (effect, "", "", nan, nan, nan, "", "not judged", "", why) for effect, why in self.not_judged
        ]
        return pd.DataFrame(rows, columns=COLUMNS)


def _entry(effect: MeasuredEffect) -> dict:
    """Return an entry of effects.json."""
    values = asdict(effect)
    interval = values.pop("interval")
    return values | {"interval_95": interval, "informs": INFORMS[effect.effect]}
