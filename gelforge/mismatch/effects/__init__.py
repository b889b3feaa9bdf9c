"""The catalogue of left-out physics: every file of this folder is one effect and defines `EFFECT`."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pkgutil import iter_modules

from gelforge.mismatch.model.effect import Effect


def found() -> dict[str, Effect]:
    """Return the effects of this folder by name, in alphabetical order.

    Raises TypeError for a file without an Effect, ValueError for one whose effect has another name than the file.
    """
    effects = {}
    for name in sorted(module.name for module in iter_modules(__path__)):
        effect = getattr(import_module(f"{__name__}.{name}"), "EFFECT", None)
        if not isinstance(effect, Effect):
            raise TypeError(
                f"mismatch/effects/{name}.py defines no EFFECT of class Effect; every file there is one effect"
            )
        if effect.name != name:
            raise ValueError(
                f"mismatch/effects/{name}.py holds the effect {effect.name!r}; name the file as the effect"
            )
        effects[name] = effect
    return effects


CATALOGUE: dict[str, Effect] = found()


def with_taken(effects: Iterable[Effect]) -> list[Effect]:
    """Return effects and those whose derivatives they are made of."""
    own = list(effects)
    return list(dict.fromkeys([*own, *(CATALOGUE[name] for effect in own for name in effect.takes)]))
