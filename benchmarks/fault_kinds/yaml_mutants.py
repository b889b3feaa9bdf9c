"""Mutants of a YAML file: one value, key or line that cannot be meant."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import yaml

from benchmarks.fault_kinds.table_mutants import Mutant

Place = tuple[str | int, ...]
# Keys whose numbers a person chooses freely within their range: another value is another choice, no mistake.
CHOSEN = {
    "seed", "nx", "ny", "regions", "moved_px", "cells_per_shard", "test_fraction", "hidden", "steps", "samples",
    "validation_fraction", "sites", "depths", "friction", "bulk_to_shear", "share", "near_mm",
    "near_radius_mm", "far_mm", "noise", "stiffness_scatter", "particle_volume_fraction", "stiffness_factor",
    "stiffness_scale", "rotation_deg", "orientation_deg", "temperature_C", "sensor_age_days", "origin_mm", "alpha",
    "range_N", "resolution_N", "noise_N", "unload_depths_mm", "focal_px", "centre_px", "position_mm", "mu_kPa",
    "plausible_shear_modulus_kPa", "tared", "mirrored", "change_mm", "gel", "layer_thickness_mm",
}  # fmt: skip


MAY_BE_ZERO = {"wall_mm"}  # a sensor without a wall
DECIDES_NO_FORCE = {"length_mm"}  # of a cylinder's shaft above the sensor


def leaves(content: Any, place: Place = ()) -> Iterator[Place]:
    """Yield the places of all values that hold no others."""
    parts = (
        content.items()
        if isinstance(content, dict)
        else enumerate(content)
        if isinstance(content, list)
        else ()
    )
    for key, part in parts:
        if isinstance(part, (dict, list)):
            yield from leaves(part, (*place, key))
        else:
            yield (*place, key)


def at(content: Any, place: Place) -> Any:
    for key in place:
        content = content[key]
    return content


def put(content: Any, place: Place, value: Any) -> bytes:
    """Return the text with another value at a place."""
    content = copy.deepcopy(content)
    at(content, place[:-1])[place[-1]] = value
    return yaml.safe_dump(content, sort_keys=False).encode()


def _place(content, rng, wanted=lambda value: True) -> Place | None:
    found = [place for place in leaves(content) if wanted(at(content, place))]
    return found[rng.integers(len(found))] if found else None


def _words(place: Place) -> str:
    return ".".join(map(str, place))


def _is_number(value) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _chosen(place: Place) -> bool:
    return any(key in CHOSEN for key in place if isinstance(key, str))


def wrong_type(content, rng) -> Mutant | None:
    place = _place(content, rng, _is_number)
    if place is None:
        return None
    value = ([], {}, "text", [1, [2]], {"a": 1}, "1,5", "1 mm")[rng.integers(7)]
    return Mutant(put(content, place, value), f"{_words(place)} is {value!r}")


def truth(content, rng) -> Mutant | None:
    place = _place(content, rng, _is_number)
    if place is None:
        return None
    word = ("true", "yes", "on", "True", "no")[rng.integers(5)]
    text = put(content, place, "HERE").replace(b"HERE", word.encode())
    return Mutant(text, f"{_words(place)} is {word}")


def _scaled(change: Callable[[float], float], name: str):
    def mutate(content, rng) -> Mutant | None:
        place = _place(content, rng, _is_number)
        if place is None:
            return None
        value = change(at(content, place))
        may = _chosen(place) or place[-1] in (MAY_BE_ZERO if value == 0 else DECIDES_NO_FORCE)
        return Mutant(put(content, place, value), f"{_words(place)}: {name} ({value:g})", may)

    return mutate


def not_a_number(content, rng) -> Mutant | None:
    place = _place(content, rng, _is_number)
    if place is None:
        return None
    word = (".nan", ".inf", "-.inf", "nan", "1e999", "9" * 5000, "~")[rng.integers(7)]
    text = put(content, place, "HERE").replace(b"HERE", word.encode())
    return Mutant(
        text, f"{_words(place)} is {word[:8]}", word == "~"
    )  # null takes the default where there is one


def key_misspelt(content, rng) -> Mutant:
    place = _place(content, rng)
    keys = [k for k, key in enumerate(place) if isinstance(key, str)]
    where = place[: keys[-1] + 1]
    new = copy.deepcopy(content)
    section = at(new, where[:-1])
    section[f"{where[-1]}x"] = section.pop(where[-1])
    named = len(where) > 1 and not isinstance(at(content, where[:-1]), list) and _chosen(where)
    return Mutant(yaml.safe_dump(new, sort_keys=False).encode(), f"{_words(where)} misspelt", named)


def key_twice(content, rng) -> Mutant:
    keys = list(content)
    key = keys[rng.integers(len(keys))]
    text = yaml.safe_dump(content, sort_keys=False)
    return Mutant((text + yaml.safe_dump({key: content[key]})).encode(), f"{key} stands twice")


def key_removed(content, rng) -> Mutant:
    new = copy.deepcopy(content)
    key = list(new)[rng.integers(len(new))]
    del new[key]
    return Mutant(
        yaml.safe_dump(new, sort_keys=False).encode(), f"without {key}", True
    )  # then its default holds


def alias(content, rng) -> Mutant | None:
    one, two = _place(content, rng, _is_number), _place(content, rng, lambda v: isinstance(v, str))
    if one is None or two is None:
        return None
    text = put(content, one, "HERE").decode().replace("HERE", "*text")
    return Mutant(
        f"x_text: &text {at(content, two)!r}\n{text}".encode(), f"{_words(one)} is an alias of a text"
    )


def alias_bomb(content, rng) -> Mutant:
    lines = ["a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8]"]
    depth = int(rng.integers(6, 30))
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 8)}]" for i in range(1, depth)]
    loop = ["loop: &loop [*loop]"] if rng.random() < 0.3 else []
    text = "\n".join([*lines, *loop]) + "\n" + yaml.safe_dump(content, sort_keys=False)
    return Mutant(text.encode(), f"aliases of {depth} levels{', in a loop' if loop else ''}")


def truncated(content, rng) -> Mutant:
    text = yaml.safe_dump(content, sort_keys=False).encode()
    cut = int(rng.integers(len(text)))
    return Mutant(
        text[:cut], f"cut after {cut} bytes", True
    )  # what is left may be a file of fewer keys or digits


def encoding(content, rng) -> Mutant:
    text = yaml.safe_dump(content, sort_keys=False)
    name = ("utf-8-sig", "utf-16", "utf-32", "cp037", "latin-1")[rng.integers(5)]
    return Mutant((text + ("# Größe\n" if name == "latin-1" else "")).encode(name), name)


def byte_inserted(content, rng) -> Mutant:
    text = bytearray(yaml.safe_dump(content, sort_keys=False).encode())
    where = int(rng.integers(len(text)))
    damage = (b"\x00", b"\t", b"\xff", b":", b"\n", b"&", b"{", b'"')[rng.integers(8)]
    text[where:where] = damage
    return Mutant(
        bytes(text), f"{damage!r} inserted at byte {where}", True
    )  # a value or a name may read on otherwise


MUTATIONS: dict[str, Callable[[Any, np.random.Generator], Mutant | None]] = {
    "wrong type": wrong_type,
    "true as a number": truth,
    "zero": _scaled(lambda value: 0, "zero"),
    "negative": _scaled(lambda value: -abs(value) - 1e-3, "negative"),
    "huge": _scaled(lambda value: 1e300, "huge"),
    "factor 1000": _scaled(lambda value: value * 1000 if value < 1e6 else value / 1000, "times 1000"),
    "no number": not_a_number,
    "key misspelt": key_misspelt,
    "key twice": key_twice,
    "key missing": key_removed,
    "alias": alias,
    "alias bomb": alias_bomb,
    "truncated": truncated,
    "encoding": encoding,
    "byte inserted": byte_inserted,
}
