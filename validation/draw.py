"""Cases drawn at random from one seed: nulls, single effects, pairs, and effects outside every catalogue."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from .kinds import KINDS, OUTSIDE, Drawn, Kind
from .library import Library
from .presses import timeline
from .recording import (
    Instrument,
    change_of,
    described,
    drawn_instrument,
    recorded,
    signal_to_noise,
    with_circumstances,
)
from .world import World, zeroed

SNR = (2.0, 30.0)  # of what is concealed, drawn evenly in its logarithm
DEVELOPMENT = 1000  # seeds below it are for development; the reporting set's comes from a commit and is above
SIZE_DIGITS = 6  # of an amplitude: its iterations end in other last digits on other machines
# What a needed finite-element solution is called, of kinds that need one
NEEDS = {
    "gel moduli": ["gel stiffer", "gel softer"], "skin moduli": ["gel stiffer", "gel softer"],
    "power law": ["gel stiffer", "gel softer"], "scalar damage": ["gel stiffer", "gel softer"],
    "slow curing": ["gel stiffer", "gel softer"], "absolute temperature": ["gel stiffer", "gel softer"],
    "yeoh stiffening": ["stiffening"], "softer volume": ["compressible"], "slab": ["slab"],
    "coulomb penalty": ["friction"], "thicker mesh": ["thicker", "thinner"], "wedge": ["thicker", "thinner"],
    "other wall": ["stiffer wall"], "weak strip": ["wall gap"], "another ball": ["larger ball"],
    "fitted laws": ["neo-Hooke"], "smooth ball": ["friction"],
    "film without shear": ["delamination"], "empty ball": ["void"], "hard ball": ["inclusion"],
}  # fmt: skip


# The bases that are judged: which configuration, and which solved change makes the recording's truth into it.
BASES: dict[str, list[tuple[str, float]]] = {
    "concealed": [],
    "neo_hooke": [("neo-Hooke", 1.0)],
    "rough": [("friction", 1.0)],
}
ON_OR_OFF = (
    "empty ball", "hard ball", "film without shear", "fitted laws", "smooth ball", "coulomb penalty",
)  # fmt: skip


@dataclass(frozen=True)
class Concealed:
    """One effect in a case."""

    kind: Kind
    size: float
    drawn: Drawn


@dataclass(frozen=True)
class Case:
    """A recording and what is hidden in it."""

    name: str
    content: str  # null, single, pair, outside
    base: str
    rows: pd.DataFrame
    instrument: Instrument
    readings: np.ndarray  # (R, 3) [N]
    truth: dict


def seed_of_commit(commit: str) -> int:
    """Return the reporting seed of the commit that froze the analysis."""
    return DEVELOPMENT + int(hashlib.sha256(f"concealed {commit}".encode()).hexdigest()[:12], 16)


def cases(
    library: Library, seed: int, nulls: int = 200, singles: int = 45, pairs: int = 20, outside: int = 24
) -> Iterator[Case]:
    """Yield the cases of a set in random order; names tell nothing. Each is drawn from the seed and its own number."""
    contents = ["null"] * nulls + ["single"] * singles + ["pair"] * pairs + ["outside"] * outside
    rng = np.random.default_rng([seed, 0])
    order = rng.permutation(len(contents))
    forms = {
        kind: _shuffled(rng, known)
        for kind, known in (("single", _known(library)), ("outside", list(OUTSIDE)))
    }
    count = {"single": 0, "outside": 0}
    for number, which in enumerate(order):
        content = contents[which]
        wanted = None
        if content in count:  # every kind in turn
            wanted = forms[content][count[content] % len(forms[content])]
            count[content] += 1
        yield make_case(library, f"c{number:03d}", content, np.random.default_rng([seed, 1, number]), wanted)


def make_case(
    library: Library, name: str, content: str, rng: np.random.Generator, form: str | None = None
) -> Case:
    """Return a case of some content; kinds whose amounts reach no sufficient signal are drawn anew."""
    while True:
        kinds = _kinds(library, content, rng, form)
        base = next((kind.base for kind in kinds if kind.base != "concealed"), _base(library, content, rng))
        sessions = max([kind.sessions for kind in kinds], default=1)
        if rng.random() < 0.2:
            sessions = 2
        fixed = {
            key: next((getattr(k, key) for k in kinds if getattr(k, key) is not None), None)
            for key in ("zero_by", "tared")
        }
        instrument = drawn_instrument(rng, sessions, **fixed)
        rows = with_circumstances(timeline(rng, sessions), instrument)
        plain = base_world(library, base)
        hidden = []
        for kind in kinds:
            low = SNR[0] if content != "pair" else 4.0
            wanted = float(np.exp(rng.uniform(np.log(low), np.log(SNR[1]))))
            drawn = kind.draw(rng)
            size = _size(plain, library, base, kind, drawn, rows, instrument, wanted)
            hidden.append(Concealed(kind, size, drawn))
        if all(_signal(plain, library, base, [one], rows, instrument) >= SNR[0] for one in hidden):
            break
        form = None if content == "pair" else form
        if content in ("single", "outside") and rng.random() < 0.25:
            form = None
    world = base_world(library, base)
    for one in hidden:
        one.kind.put(world, one.size, one.drawn)
    readings = recorded(world, rows, instrument, rng)
    truth = _truth(name, content, base, plain, library, world, hidden, rows, instrument)
    return Case(name, content, base, rows, instrument, readings, truth)


def base_world(library: Library, base: str) -> World:
    """Return the world of a base study, nothing hidden."""
    world = World(library)
    for name, share in BASES[base]:
        change = library.changes[name]
        world.changes.append(
            lambda xy, depth, change=change, share=share: tuple(share * part for part in change.at(xy, depth))
        )
    return world


def _with(library: Library, base: str, hidden: list[Concealed]) -> World:
    world = base_world(library, base)
    for one in hidden:
        one.kind.put(world, one.size, one.drawn)
    return world


def _signal(plain, library, base, hidden, rows, instrument, floor: bool = True) -> float:
    change = change_of(plain, _with(library, base, hidden), rows, instrument.tared)
    return signal_to_noise(plain, rows, instrument, change, floor)


def _size(plain, library, base, kind, drawn, rows, instrument, wanted: float) -> float:
    """Return the amplitude whose signal is the wanted one, at most the kind's largest: signals grow about in proportion."""
    if kind.form in ON_OR_OFF:
        return 1.0
    size = min(1.0, kind.most)
    for _ in range(3):
        found = _signal(plain, library, base, [Concealed(kind, size, drawn)], rows, instrument)
        size = min(size * wanted / max(found, 1e-3), kind.most)
    return round(float(size), SIZE_DIGITS)


def _kinds(library: Library, content: str, rng, form: str | None) -> list[Kind]:
    if content == "null":
        return []
    if content == "outside":
        return [OUTSIDE[form or str(rng.choice(list(OUTSIDE)))]]
    known = _known(library)
    if content == "single":
        return [KINDS[form or str(rng.choice(known))]]
    while True:
        two = [KINDS[str(f)] for f in rng.choice(known, 2, replace=False)]
        needs = [(k.zero_by, k.tared) for k in two]
        agree = all(a is None or b is None or a == b for a, b in zip(*needs))
        if (
            two[0].family != two[1].family
            and agree
            and "simplification" not in (two[0].family, two[1].family)
        ):
            return two


def _known(library: Library) -> list[str]:
    """Return the kinds whose solutions are all there."""
    solved = set(library.changes) | {name for name, _ in library.defects}
    return [form for form in KINDS if all(name in solved for name in NEEDS.get(form, []))]


def _base(library: Library, content: str, rng) -> str:
    """Return the base of a case: nulls have all of them, what is concealed stands on the first."""
    there = [
        name for name, changes in BASES.items() if all(change in library.changes for change, _ in changes)
    ]
    return str(rng.choice(there)) if content == "null" else "concealed"


def _shuffled(rng, names: list[str]) -> list[str]:
    return [names[k] for k in rng.permutation(len(names))]


def _truth(name, content, base, plain, library, world, hidden, rows, instrument) -> dict:
    effects = []
    for one in hidden:
        effect = {
            "name": one.kind.name,
            "form": one.kind.form,
            "family": one.kind.family,
            "size": one.size,
            "drawn": one.drawn,
            "amounts": one.kind.amounts(one.size, one.drawn),
            "snr": round(_signal(plain, library, base, [one], rows, instrument), 3),
        }
        if "place" in one.drawn:
            effect["where"] = _where(one)
        effects.append(effect)
    clean = zeroed(rows, world.forces(rows), instrument.tared)
    return {
        "case": name,
        "content": content,
        "base": base,
        "effects": effects,
        "snr": round(_signal(plain, library, base, hidden, rows, instrument), 3) if hidden else 0.0,
        "snr_instrument": round(_signal(plain, library, base, hidden, rows, instrument, False), 3) if hidden else 0.0,
        "instrument": described(instrument),
        "readings": {  # without depth errors, noise and steps: what a perfect model of what is hidden would say
            "session": rows["session"].tolist(), "press": rows["press"].tolist(), "phase": rows["phase"].tolist(),
            "time_s": rows["time_s"].tolist(), "force_N": np.round(clean, 6).tolist(),
        },
    }  # fmt: skip


def _where(one: Concealed) -> dict:
    from .presses import MIDDLE
    from .solves import DEFECT_PLACES, DEFECTS

    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), one.drawn["turns"])
    x, y = turn @ np.array(DEFECT_PLACES[one.drawn["place"]][0]) + MIDDLE
    keys = DEFECTS[{"empty ball": "void", "hard ball": "inclusion"}.get(one.kind.form, "delamination")]
    return {"x_mm": float(x), "y_mm": float(y), "radius_mm": keys["radius_mm"]}
