"""Cases drawn at random from one seed: nulls, single effects, pairs, and effects outside every catalogue."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import pandas as pd

from . import body_forms as body
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
from .separation import separation
from .world import World, zeroed

SNR = (2.0, 30.0)  # of what is concealed, drawn evenly in its logarithm
DEVELOPMENT = 1000  # seeds below it are for development; the reporting set's comes from a commit and is above
SIZE_DIGITS = 6  # of an amplitude: its iterations end in other last digits on other machines
CONTENTS = ("null", "single", "pair", "outside")
# Kinds that move a press sideways: nothing of them is felt where all places are alike.
NEEDS_PLACES = ("pressed elsewhere", "turned grid", "stretched grid", "backlash")
NEEDS_UNLOADING = ("jkr",)  # adhesion is felt as the ball leaves
# Made as a frictionless ball pushes, along the surface's normal; where it sticks the sideways force is another one.
NEEDS_NO_FRICTION = ("wedge", "turned body")
# What a needed finite-element solution is called, of kinds that need one
NEEDS = {
    "gel moduli": ["gel stiffer", "gel softer"], "skin moduli": ["gel stiffer", "gel softer"],
    "power law": ["gel stiffer", "gel softer"], "scalar damage": ["gel stiffer", "gel softer"],
    "slow curing": ["gel stiffer", "gel softer"], "absolute temperature": ["gel stiffer", "gel softer"],
    "stretched exponential": ["gel stiffer", "gel softer"], "broken chains": ["gel stiffer", "gel softer"],
    "drying": ["gel stiffer", "gel softer"], "activated": ["gel stiffer", "gel softer"],
    "yeoh stiffening": ["stiffening"], "third-order stiffening": ["late stiffening"], "no friction": ["smooth"],
    "softer volume": ["compressible"], "slab": ["slab"],
    "coulomb penalty": ["friction"], "thicker mesh": ["thicker", "thinner"], "wedge": ["thicker", "thinner"],
    "other wall": ["stiffer wall"], "weak strip": ["wall gap"], "another ball": ["larger ball"],
    "fitted laws": ["neo-Hooke"], "smooth ball": ["friction"],
    "film without shear": ["delamination"], "empty ball": ["void"], "hard ball": ["inclusion"],
}  # fmt: skip


@dataclass(frozen=True)
class Base:
    """A study that is judged: its sensor, and which solved changes, by their share, make the sensor's library into it."""

    sensor: str
    changes: tuple[tuple[str, float], ...] = ()
    doubts: dict[str, float] = field(
        default_factory=dict
    )  # by layer: relative standard deviation of its stated moduli


BASES: dict[str, Base] = {  # by their configuration in `config`
    "concealed": Base("small"),
    "neo_hooke": Base("small", (("neo-Hooke", 1.0),)),
    "rough": Base("small", (("friction", 1.0),)),
    "thin": Base("thin", doubts={"gel": 0.02, "skin": 0.03}),
    "wide": Base("wide"),
}
LAYERS = {"gel": body.gel, "skin": body.skin}  # what changes the moduli of a layer
ON_OR_OFF = (
    "empty ball", "hard ball", "film without shear", "fitted laws", "smooth ball", "coulomb penalty", "no friction",
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


def seed_of_commit(commit: str, bases: Sequence[str] = ("concealed",)) -> int:
    """Return the reporting seed of the commit that froze the analysis, another one for each choice of bases."""
    own = "" if tuple(bases) == ("concealed",) else " " + " ".join(bases)
    return DEVELOPMENT + int(hashlib.sha256(f"concealed {commit}{own}".encode()).hexdigest()[:12], 16)


def cases(
    libraries: Mapping[str, Library],
    seed: int,
    numbers: Mapping[str, int],
    bases: Sequence[str] = ("concealed",),
    least: float = SNR[0],
) -> Iterator[Case]:
    """Yield the cases of a set in random order; names tell nothing. Each is drawn from the seed and its own number.

    libraries: by sensor. numbers: how many of each content of CONTENTS. bases take turns, and on each base every kind does.
    least: the smallest signal-to-noise ratio of what is hidden.
    """
    contents = [content for content in CONTENTS for _ in range(numbers.get(content, 0))]
    rng = np.random.default_rng([seed, 0])
    order = rng.permutation(len(contents))
    forms = {
        (base, content): _shuffled(rng, known)
        for base in bases
        for content, known in (("single", known_on(libraries, base)), ("outside", list(OUTSIDE)))
    }
    count = Counter()
    for number, which in enumerate(order):
        content = contents[which]
        base = bases[count[content] % len(bases)]
        wanted = None
        if (base, content) in forms:  # every kind in turn
            own = forms[base, content]
            wanted = own[count[base, content] % len(own)]
            count[base, content] += 1
        count[content] += 1
        draws = np.random.default_rng([seed, 1, number])
        yield make_case(libraries, f"c{number:03d}", content, draws, wanted, base, least)


def make_case(
    libraries: Mapping[str, Library],
    name: str,
    content: str,
    rng: np.random.Generator,
    form: str | None = None,
    base: str = "concealed",
    least: float = SNR[0],
) -> Case:
    """Return a case of some content on a base; kinds whose values reach no sufficient signal are drawn anew."""
    library = libraries[BASES[base].sensor]
    low = max(least, 4.0) if content == "pair" else least
    while True:
        kinds = _kinds(libraries, content, rng, form, base)
        sessions = max([kind.sessions for kind in kinds], default=1)
        if rng.random() < 0.2:
            sessions = 2
        fixed = {
            key: next((getattr(k, key) for k in kinds if getattr(k, key) is not None), None)
            for key in ("zero_by", "tared")
        }
        instrument = drawn_instrument(rng, sessions, **fixed)
        rows = with_circumstances(timeline(rng, library.sensor.plan, sessions), instrument)
        plain = base_world(library, base)
        hidden = []
        for kind in kinds:
            wanted = float(np.exp(rng.uniform(np.log(low), np.log(SNR[1]))))
            drawn = kind.draw(rng)
            size = _size(plain, library, base, kind, drawn, rows, instrument, wanted)
            hidden.append(Concealed(kind, size, drawn))
        if all(_signal(plain, library, base, [one], rows, instrument) >= least for one in hidden):
            break
        form = None if content == "pair" else form
        if content in ("single", "outside") and rng.random() < 0.25:
            form = None
    world, moduli = base_world(library, base), _drawn_moduli(base, rng)
    for layer, relative in moduli.items():
        LAYERS[layer](world, relative / body.MODULI, {"sign": 1.0})
    for one in hidden:
        one.kind.put(world, one.size, one.drawn)
    readings = recorded(world, rows, instrument, rng)
    truth = _truth(name, content, base, plain, library, world, hidden, rows, instrument)
    if content == "single":
        change = change_of(plain, _with(library, base, hidden), rows, instrument.tared)
        known, doubts = known_on(libraries, base), _doubts(plain, library, base, rows, instrument)
        truth["separation"] = separation(plain, known, hidden[0].kind, change, rows, instrument, doubts)
    return Case(name, content, base, rows, instrument, readings, truth | {"moduli": moduli})


def _drawn_moduli(base: str, rng) -> dict[str, float]:
    """Return by how much gel and skin are stiffer than their constitutive models say, drawn from what these state."""
    return {layer: round(float(rng.normal(0, doubt)), 6) for layer, doubt in BASES[base].doubts.items()}


def base_world(library: Library, base: str) -> World:
    """Return the world of a base study, nothing hidden."""
    world = World(library)
    for name, share in BASES[base].changes:
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
    return signal_to_noise(
        plain, rows, instrument, change, floor, _doubts(plain, library, base, rows, instrument)
    )


def _doubts(plain, library, base, rows, instrument) -> list[np.ndarray]:
    """Return what a standard deviation of each doubtful modulus of a base changes (R, 3) [N]."""
    found = []
    for layer, doubt in BASES[base].doubts.items():
        world = base_world(library, base)
        LAYERS[layer](world, doubt / body.MODULI, {"sign": 1.0})
        found.append(change_of(plain, world, rows, instrument.tared))
    return found


def _size(plain, library, base, kind, drawn, rows, instrument, wanted: float) -> float:
    """Return the amplitude whose signal is the wanted one, at most the kind's largest: signals grow about in proportion."""
    if kind.form in ON_OR_OFF:
        return 1.0
    size = min(1.0, kind.most)
    for _ in range(3):
        found = _signal(plain, library, base, [Concealed(kind, size, drawn)], rows, instrument)
        size = min(size * wanted / max(found, 1e-3), kind.most)
    return round(float(size), SIZE_DIGITS)


def _kinds(libraries: Mapping[str, Library], content: str, rng, form: str | None, base: str) -> list[Kind]:
    if content == "null":
        return []
    if content == "outside":
        return [OUTSIDE[form or str(rng.choice(list(OUTSIDE)))]]
    known = known_on(libraries, base)
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


def known_on(libraries: Mapping[str, Library], base: str) -> list[str]:
    """Return the kinds that can be hidden on a base: their solutions are all there, and the readings change with them."""
    library = libraries[BASES[base].sensor]
    rubs = library.sensor.plain.friction > 0 or any(name == "friction" for name, _ in BASES[base].changes)
    solved = set(library.changes) | {name for name, _ in library.defects}
    return [
        form
        for form, kind in KINDS.items()
        if kind.base in ("", base)
        and all(name in solved for name in NEEDS.get(form, []))
        and not (library.sensor.alike and form in NEEDS_PLACES)
        and (library.sensor.plan.unloading or form not in NEEDS_UNLOADING)
        and not (rubs and form in NEEDS_NO_FRICTION)
    ]


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
            "parameters": one.kind.parameters(one.size, one.drawn),
            "snr": round(_signal(plain, library, base, [one], rows, instrument), 3),
        }
        if "place" in one.drawn:
            effect["where"] = _where(one, library.sensor.middle)
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


def _where(one: Concealed, middle: np.ndarray) -> dict:
    from .solves import DEFECT_PLACES, DEFECTS

    turn = np.linalg.matrix_power(np.array([[0.0, -1.0], [1.0, 0.0]]), one.drawn["turns"])
    x, y = turn @ np.array(DEFECT_PLACES[one.drawn["place"]][0]) + middle
    keys = DEFECTS[{"empty ball": "void", "hard ball": "inclusion"}.get(one.kind.form, "delamination")]
    return {"x_mm": float(x), "y_mm": float(y), "radius_mm": keys["radius_mm"]}
