"""What `gelforge check` says of a study's split, and of its sessions."""

from __future__ import annotations

from gelforge.config import Study


def check_split(study: Study, cells: dict) -> int:
    """Print how far test sites lie from training sites; return 1 where that is doubtfully near, else 0."""
    from gelforge.dataset.splits import planned_split, separation

    split, orbit = planned_split(cells, study.sensor, study.dataset.test_fraction, study.seed)
    tests = sum(side == "test" for side in split.values())
    gap = separation(cells, split, study.sensor)
    if gap is None:
        print(f"split      {len(cells)} sites in {len(set(orbit.values()))} groups: none is held out")
        return 0
    print(
        f"split      {tests} of {len(cells)} sites are held out, {gap.smallest_mm:.3g} mm and more from training sites and"
        f" their mirror images ({gap.test_site} from {gap.training_site}); usual spacing {gap.spacing_mm:.3g} mm"
    )
    if gap.doubtful:
        print(
            f"note       split: {gap.smallest_mm:.3g} mm is below half of the usual spacing: images at {gap.test_site}"
            f" are nearly those of training at {gap.training_site}, or mirror images of them. If both were meant to be one"
            " position, state stage_to_sensor.repeatability_mm in session.yaml or plan.tolerance_mm in the study"
        )
    return int(gap.doubtful)


def unnamed_sessions(study: Study) -> list[str]:
    """Return the sessions that lie in the study's folder of recordings and that the study does not name."""
    recorded = study.session_folder("x").parent.glob("*/indentations.csv")
    return sorted({path.parent.name for path in recorded} - set(study.sessions))


def print_unnamed(study: Study) -> None:
    """Print the line to add for sessions on disk that the study does not name."""
    names = unnamed_sessions(study)
    if names:
        folder = study.session_folder(names[0]).parent.as_posix()
        print(
            f"not named  {', '.join(names)} in {folder}: recorded, but not read; the line would be"
            f" sessions: [{', '.join([*study.sessions, *names])}]"
        )
