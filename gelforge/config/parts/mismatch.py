"""How a recording is judged against the study: places, effects, errors."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gelforge.section import GrownSection, Name, NonNegative, Section


class Known(Section):
    """An effect of force sensor, clock, camera or single indentations that is taken as known, in the nominal model."""

    effect: Name = Field(description="name in the catalogue")
    parameters: dict[str, float] = Field(description="value by parameter, in the parameter's unit")
    hyperparameters: dict[str, float | str] = Field(
        {}, description="hyperparameters of the effect: scanned, not fitted"
    )


class Mismatch(GrownSection):
    """How the judge looks for missing physics."""

    later = ("judged",)
    judged: bool = Field(
        True,
        description="a run of the study makes the verdict on its sessions: minutes to an hour, `gelforge check` estimates"
        " them; false: it does not, and no derivatives are stored for it",
    )
    sites: int = Field(
        25, ge=2, description="positions that are judged at most, spread over those recorded [-]"
    )
    depths: int | None = Field(
        None, ge=3, description="depths that are judged at most, spread over those pressed to; null: all [-]"
    )
    coarser: float = Field(
        2.0,
        ge=1.2,
        le=6.0,
        description="changes by effects are solved on a mesh of so many times the study's sizes; under a ball its elements"
        " should be below a quarter of the radius [-]",
    )
    draws: int = Field(2000, ge=1000, description="draws of the maximum statistic of the scan [-]")
    known: list[Known] = Field([], description="effects that belong to the nominal model")
    leave_out: list[Name] = Field([], description="effects of the catalogue that are not tried")
    discretisation: NonNegative | None = Field(
        None,
        description="standard deviation of the nominal model's discretisation error as a share of the force, where it is"
        " known better than from a mesh of twice the sizes [-]",
    )
    change_error: NonNegative = Field(
        0.1,
        description="error of a change by an effect that is solved, a standard deviation as a share of it; at least that of"
        " the effect's form, which is 0.1, 0.2 or 0.3 before the readings, with a place 0.5; 0: none for any effect [-]",
    )
    sensitivities: Literal["auto", "stored", "none"] = Field(
        "auto",
        description="derivatives of the forces at every solved site are stored, so that a verdict needs few solutions of"
        " its own: in studies with sessions (auto), always, or not at all",
    )
    contact_point_scatter_mm: NonNegative | None = Field(
        None,
        description="standard deviation of the contact point, in place of what the sessions state [mm]",
    )
    images: Literal["auto", "fitted", "predicted", "left_out"] = Field(
        "auto",
        description="images of sessions with a camera are judged with the forces where these leave several effects that"
        " images distinguish, and for these effects (auto); always judged with the forces, predicted from them, or left out",
    )
