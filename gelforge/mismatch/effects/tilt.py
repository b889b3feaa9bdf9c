"""The sensor stands at an angle to the indenter's path."""

from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import amount, as_rotation, first_order, pair_of, solver

SOURCE = "width: mounted by eye (judgement); bounds: seen by eye"

EFFECT = Effect(
    name="tilt",
    family="kinematics",
    parameters=tuple(amount("tilt", about, (-5.0, 5.0), SOURCE) for about in ("about_x", "about_y")),
    signature="lateral force of one sign at every place; where depth is counted from one touch of the session also deeper on"
    " one side, first at small depths",
    confused_with=("thickness_gradient", "cross_talk", "contact_zero", "misregistration"),
    separated_by="contact found at every indentation against once per session; small depths at opposite edges; a"
    " spirit level",
    **solver("tilt")
    | {
        "to_study": pair_of(
            "kinematics",
            lambda study: study.mechanics.effects.kinematics.tilt_deg,
            lambda study, both: {"tilt_deg": both},
        ),
        "to_forces": first_order("tilt", "about_x", "about_y"),
        "turned": as_rotation,
    },
)
