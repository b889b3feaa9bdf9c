"""`gelforge mesh`: the mesh of an indentation, to be looked at."""

from __future__ import annotations

from pathlib import Path

from gelforge.cli.by_hand.press import described_press


def mesh(x: float, y: float, depth: float, indenter: Path | None, out: Path, study: Path | None) -> None:
    """Write the undeformed mesh on which a press at this place and depth is solved; print which number is which region."""
    from gelforge.indentation.paths.trajectory import Trajectory
    from gelforge.indentation.planning.plan import check_inside, press_path
    from gelforge.indentation.sensor.indenter_shapes import shape_of
    from gelforge.indentation.solving.model import meshes_of
    from gelforge.meshing.tetrahedra import write_mesh

    described = described_press(study, indenter)
    planned = press_path("press", x, y, [depth], None, False)
    check_inside({planned.name: planned}, described)
    described.mechanics.effects.check(described.sensor)
    shape, trajectory = shape_of(described.indenter), Trajectory.of(planned, described.plan.approach)
    _, made = meshes_of(described.sensor, shape, described.mechanics, trajectory)
    write_mesh(out, made)
    for number, name in enumerate(made.regions):
        print(f"region {number}: {name}, {(made.region == number).sum()} elements")
    print(f"{len(made.X)} nodes, written to {out}")
