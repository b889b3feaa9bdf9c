"""All checks in the order of the table."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from gelforge.progress import tracked
from gelforge.verification import elements, friction, presses
from gelforge.verification.check import Check

CHECKS: dict[str, Callable[[], list[Check]]] = {
    function.__name__: function
    for function in (
        elements.uniaxial_stress,
        elements.patch_test,
        elements.rigid_modes,
        elements.manufactured_orders,
        presses.contact_patch,
        presses.hertz_presses,
        presses.bonded_layers,
        presses.balances,
        presses.energy_and_cycle,
        presses.augmentation_independence,
        presses.quarter_turn,
        friction.partial_slip,
        friction.pressed_stick_zone,
        friction.cone_edge,
        friction.frictionless_slide,
    )
}


def run_checks(names: Sequence[str] = tuple(CHECKS)) -> Iterator[Check]:
    """Yield the checks of the finite elements as they are done; all take about a minute on one core.

    Parameters
    ----------
    names : sequence of str
        Keys of CHECKS; all by default.

    Yields
    ------
    Check
        Value, reference and limit.
    """
    for name in tracked(names, "checks of the finite elements"):
        yield from CHECKS[name]()
