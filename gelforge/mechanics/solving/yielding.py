"""An indentation whose machine or base plate yields: the indenter lags the commanded path by compliance times force."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from gelforge.mechanics.contact.state import State
from gelforge.mechanics.solving.equilibrium import NotConverged, Press, Watch, padded

MAX_SOLVES = 12  # of one step: the secant takes three to five
SHARE_OF_GAP = 1e-2  # of the contact's own tolerance: to this the place of the indenter is found


def follow_yielding(
    press: Press,
    start: State,
    commanded: np.ndarray,
    yielding: np.ndarray | None,
    times: np.ndarray | None = None,
    watch: Watch | None = None,
    begun: np.ndarray | None = None,
) -> Iterator[State]:
    """Yield the state at each commanded centre (n, 3) or (n, 6) [mm] in turn; a step that fails is halved.

    yielding (3,) [mm/N] points along the path, its length is the compliance c: the indenter is at the commanded centre
    minus c (F . a) a, a the unit vector along the path and F the force on the body. Friction is counted from the last
    state that balances, not from trials. yielding None: nothing yields, as Press.follow. times (n,) [s]: as there; so is
    watch, which is called where nothing yields. begun (3,) or (6,): the commanded centre at the start, if not the
    indenter's. Raises NotConverged.
    """
    if yielding is None:
        yield from press.follow(start, commanded, watch, times)
        return
    press.corrections.forget()
    commanded = np.asarray(commanded, dtype=float)
    c = float(np.linalg.norm(yielding))
    along = np.pad(yielding / c, (0, commanded.shape[1] - 3))
    centre = padded(start.centre, commanded.shape[1])
    at = centre if begun is None else padded(begun, commanded.shape[1])
    previous, state, lag, growth = None, replace(start, centre=centre), float((at - centre) @ along), 0.0
    for number, target in enumerate(commanded):
        iterations = factorisations = 0
        pending: list[tuple[np.ndarray, int, float | None]] = []  # aim, halvings, time
        for share in press.parts(state, target - at)[::-1]:
            time = None
            if times is not None:
                time = state.memory.time + share * (float(times[number]) - state.memory.time)
            pending.append((at + share * (target - at) if share < 1 else target, 0, time))
        while pending:
            aim, halvings, time = pending[-1]
            move = float((aim - at) @ along)
            try:
                new, new_lag, stiffness = _balanced(
                    press, previous, state, aim, along, c, lag + growth * move, time, halvings
                )
            except NotConverged as failure:
                if halvings == press.settings.max_halvings:
                    raise NotConverged(f"{failure}; step halved {halvings} times") from None
                pending[-1] = (aim, halvings + 1, time)
                between = None if time is None else (state.memory.time + time) / 2
                pending.append(((at + aim) / 2, halvings + 1, between))
                continue
            pending.pop()
            growth = c * stiffness / (1 + c * stiffness)
            previous, state, at, lag = state, new, aim, new_lag
            iterations, factorisations = iterations + new.iterations, factorisations + new.factorisations
        state = replace(state, iterations=iterations, factorisations=factorisations)
        yield state


def _balanced(
    press: Press,
    previous: State | None,
    state: State,
    aim: np.ndarray,
    along: np.ndarray,
    c: float,
    lag: float,
    time: float | None,
    halvings: int,
) -> tuple[State, float, float]:
    """Return the state at which lag = c F . along, that lag [mm], and the stiffness of the body [N/mm] there."""
    tolerance = SHARE_OF_GAP * press.settings.gap_tolerance * press.contact.element_size
    limit = press.iterations_allowed(halvings)
    guess, last, iterations, factorisations, stiffness = None, None, 0, 0, 0.0
    for _ in range(MAX_SOLVES):
        new = press.step(previous, state, aim - lag * along, guess, time, limit)
        iterations, factorisations = iterations + new.iterations, factorisations + new.factorisations
        force = float(new.force @ along[:3])
        if last is not None and last[0] != lag:
            stiffness = max(0.0, (last[1] - force) / (lag - last[0]))
        miss = c * force - lag
        if abs(miss) <= tolerance:
            return replace(new, iterations=iterations, factorisations=factorisations), lag, stiffness
        guess, last = new, (lag, force)
        lag += miss / (1 + c * stiffness)
    raise NotConverged(
        f"the machine's yielding ({c:g} mm/N) and the force do not meet after {MAX_SOLVES} solves: {miss:.1e} mm apart"
        f" (limit {tolerance:.0e} mm)"
    )
