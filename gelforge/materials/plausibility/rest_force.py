"""A force at what seems to be rest: a preload after which the extension was zeroed, or an offset of the force."""

from __future__ import annotations

from gelforge.materials.basis.common_form import MaterialTest

REST = 1e-3  # strain within which a row counts as being at rest
PRELOAD = (
    "a preload, after which the extension was set to zero (`toe: remove` moves the origin to the zero of stress; `toe` in"
    " samples.csv)"
)
OFFSET = "an offset of the force (`zero_force` subtracts it)"


def rest_words(test: MaterialTest, rest_MPa: float) -> str:
    """Return what a stress at rest [MPa] can be, with its remedy. No preload acts against the loading.

    The curve does not tell the two apart: a constant and a moved origin fit laws of three parameters equally well.
    """
    strain = test.stretch - test.at_rest
    if strain[abs(strain).argmax()] * rest_MPa < 0:
        return OFFSET
    return f"{PRELOAD}, or {OFFSET}, if the machine shows it without a specimen"
