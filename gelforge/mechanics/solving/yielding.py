"""An indentation whose machine or base plate yields: the indenter lags the commanded path by compliance times force."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gelforge.mechanics.contact.state import State
from gelforge.mechanics.solving.equilibrium import Aim, NotConverged, Press, Watch, padded


def follow_yielding(
    press: Press,
    start: State,
    commanded: np.ndarray,
    yielding: np.ndarray | None,
    times: np.ndarray | None = None,
    watch: Watch | None = None,
    begun: np.ndarray | None = None,
) -> Iterator[State]:
    """Yield the state at each commanded centre of an indenter whose machine yields; a step that fails is halved.

    The indenter is at the commanded centre minus c (F . a) a, with the compliance c, the unit vector a along the path and
    the force F on the body. Friction is counted from the last state that balances, not from trials.

    Parameters
    ----------
    press : Press
        Body, indenter and settings.
    start : State
        In equilibrium.
    commanded : numpy.ndarray
        (n, 3) [mm], or (n, 6) with turns [rad].
    yielding : numpy.ndarray or None
        (3,) [mm/N]: along the path, its length is c. None: nothing yields, as Press.follow.
    times : numpy.ndarray, optional
        (n,) [s], for a body that remembers.
    watch : callable, optional
        Called after each step where nothing yields.
    begun : numpy.ndarray, optional
        (3,) or (6,) commanded centre at the start, if not the indenter's.

    Yields
    ------
    State
        At one commanded centre.

    Raises
    ------
    NotConverged
        For a step that has no equilibrium.
    """
    if yielding is None:
        yield from press.follow(start, commanded, watch, times)
        return
    begun = start.centre if begun is None else begun
    machine = _Machine(press, yielding, start, begun, np.shape(commanded)[1])
    yield from press.follow_aims(start, begun, commanded, machine.balanced, times)


class _Machine:
    """The compliance of a machine along a path, and how far its indenter lags."""

    def __init__(self, press: Press, yielding: np.ndarray, start: State, begun: np.ndarray, length: int):
        self.press, self.compliance = press, float(np.linalg.norm(yielding))  # mm/N
        self.along = np.pad(yielding / self.compliance, (0, length - 3))
        self.lag = float((padded(begun, length) - padded(start.centre, length)) @ self.along)  # mm
        self.growth = 0.0  # of the lag, per length of the commanded path

    def balanced(self, previous: State | None, state: State, at: np.ndarray, aim: Aim) -> State:
        """Return the state at a commanded centre at which the lag is the compliance times the force along the path."""
        press, c = self.press, self.compliance
        # the place of the indenter is found to a hundredth of the contact's own tolerance
        tolerance = 1e-2 * press.settings.gap_tolerance * press.contact.element_size
        lag = self.lag + self.growth * float((aim.centre - at) @ self.along)
        guess, last, iterations, factorisations, stiffness = None, None, 0, 0, 0.0
        most = 12  # solves: the secant takes 3 to 5
        for _ in range(most):
            new = press.step(previous, state, aim.centre - lag * self.along, guess, aim.time, aim.limit)
            iterations, factorisations = iterations + new.iterations, factorisations + new.factorisations
            force = float(new.force @ self.along[:3])
            if last is not None and last[0] != lag:
                stiffness = max(0.0, (last[1] - force) / (lag - last[0]))  # N/mm, of the body
            miss = c * force - lag
            if abs(miss) <= tolerance:
                self.lag, self.growth = lag, c * stiffness / (1 + c * stiffness)
                return replace(new, iterations=iterations, factorisations=factorisations)
            guess, last = new, (lag, force)
            lag += miss / (1 + c * stiffness)
        raise NotConverged(
            f"the machine's yielding ({c:g} mm/N) and the force do not meet after {most} solves: {miss:.1e} mm apart"
            f" (limit {tolerance:.0e} mm)"
        )
