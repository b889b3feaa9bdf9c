"""The catalogue of left-out physics: every file of this folder is one effect and defines `EFFECT`."""

from collections.abc import Iterable

from gelforge.mismatch.model.effect import Effect
from gelforge.registry import defined, names_in


def catalogue_of_modules() -> dict[str, Effect]:
    """Return the effects of this folder by name, in alphabetical order; see `defined` for its errors."""
    return {name: defined(__name__, name, "EFFECT", Effect) for name in names_in(__path__)}


CATALOGUE: dict[str, Effect] = catalogue_of_modules()


def with_dependencies(effects: Iterable[Effect]) -> list[Effect]:
    """Return effects and those whose derivatives they are made of."""
    given = list(effects)
    return list(dict.fromkeys([*given, *(CATALOGUE[name] for effect in given for name in effect.depends_on)]))
