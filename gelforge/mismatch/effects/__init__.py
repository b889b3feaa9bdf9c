"""The catalogue of left-out physics: every file of this folder is one effect and defines `EFFECT`."""

from collections.abc import Iterable

from gelforge.mismatch.model.effect import Effect
from gelforge.registry import defined, names_in


def found() -> dict[str, Effect]:
    """Return the effects of this folder by name, in alphabetical order; see `defined` for its errors."""
    return {name: defined(__name__, name, "EFFECT", Effect) for name in names_in(__path__)}


CATALOGUE: dict[str, Effect] = found()


def with_dependencies(effects: Iterable[Effect]) -> list[Effect]:
    """Return effects and those whose derivatives they are made of."""
    own = list(effects)
    return list(dict.fromkeys([*own, *(CATALOGUE[name] for effect in own for name in effect.depends_on)]))
