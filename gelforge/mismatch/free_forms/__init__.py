"""Causes with a free form: every file of this folder is one and defines `FREE_FORM`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from gelforge.config import Study
from gelforge.mismatch.effects import with_dependencies
from gelforge.mismatch.evidence.candidates import candidates_of
from gelforge.mismatch.evidence.kernels import FreeForm, Module
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.effect import Context, Effect
from gelforge.registry import defined, names_in

FREE_FORMS: dict[str, FreeForm] = {
    name: defined(__name__, name, "FREE_FORM", FreeForm) for name in names_in(__path__)
}


def derivatives_for(study: Study) -> dict[str, Effect]:
    """Return by name what is differentiated along for free forms alone, of what a study's sensor has."""
    effects = [effect for form in FREE_FORMS.values() for effect in form.derivatives]
    return {effect.name: effect for effect in effects if effect.applies(study)}


def required(study: Study, effects: Iterable[Effect]) -> list[Effect]:
    """Return all whose derivatives a verdict over some effects asks for."""
    return [*with_dependencies(effects), *derivatives_for(study).values()]


def changes_of(context: Context) -> list[Candidate]:
    """Return the linear change of the readings by each derivative that was solved for free forms and that they show."""
    return candidates_of(context, derivatives_for(context.study), {})


def modules_of(context: Context, changes: Sequence[Candidate]) -> tuple[Module, ...]:
    """Return the modules that these readings may show; changes: as of `changes_of`."""
    modules = []
    for form in FREE_FORMS.values():
        names = {effect.name for effect in form.derivatives}
        modules.append(form.module(context, [one for one in changes if one.name in names]))
    return tuple(module for module in modules if module is not None)
