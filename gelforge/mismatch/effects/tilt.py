"""The sensor stands at an angle to the indenter's path."""

from gelforge.mismatch.model.solver_effects import as_rotation, has, solved

EFFECT = solved(
    "tilt",
    ("about_x", "about_y"),
    (-5.0, 5.0),
    "width: mounted by eye (judgement); bounds: seen by eye",
    has("kinematics.tilt_deg"),
    keys=lambda study, both: {"kinematics": {"tilt_deg": both}},
    means=("the sensor is tilted under the indenter",),
    signature="lateral force of one sign at every place; where depth is counted from one touch of the session also deeper on"
    " one side, first at small depths",
    separated_by="contact found at every indentation against once per session; small depths at opposite edges; a"
    " spirit level",
    turned=as_rotation,
)
