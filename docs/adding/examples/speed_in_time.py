"""The speed of the stage differs from press to press: what is read while it moves comes from another depth."""

from gelforge.mismatch.evidence.kernels import FreeForm, Module, modes
from gelforge.mismatch.model.solver_effects import per_depth

WIDTH_MM = 0.02  # of the depth by which it is ahead or behind (judgement)


def module(context, changes):
    """Return the way by which the stage is ahead, as a smooth function of the press's number; none of one press."""
    table = context.observations.table
    moving = (table["phase"] == "unload").to_numpy()
    if table["order"].nunique() < 2 or not moving.any():
        return None
    basis = WIDTH_MM * modes(table["order"].to_numpy(float), 4)
    presses = table.drop_duplicates("press")
    return Module(
        words="the way ahead of the stage's clock over the session's time",
        directions=context.observations.flat(
            (per_depth(context) * moving[:, None])[:, :, None] * basis[:, None, :]
        ),
        name="speed_in_time",
        says="the stage's speed changes over the session",
        map=presses[["session", "time_s"]].reset_index(drop=True).assign(quantity="way ahead"),
        basis=basis[presses.index],
        unit="mm",
        of_labels=False,
        where=lambda row: f"{row['time_s']:.4g} s into {row['session']}",
    )


FREE_FORM = FreeForm("speed_in_time", module)
