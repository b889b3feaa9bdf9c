"""Calibrate a sensor's parameters by its own presses."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, load_study
from gelforge.progress import Stages, stage


def calibrate(
    recording: Path,
    config: Path,
    free: str,
    prior: list[str],
    out: Path,
    laws: list[Path],
    kept: Path | None,
    workers: int,
    page: bool,
) -> None:
    """Write calibrated parameters, materials, a patch and, if asked, the page, and print the result."""
    from gelforge.calibration.calibrate import calibrate_folder
    from gelforge.calibration.priors import prior_of
    from gelforge.calibration.results import summary

    priors = {}
    for text in prior:
        name, equals, what = text.partition("=")
        if not equals:
            raise ConfigError(f"--prior {text}: write NAME=LOW:HIGH, NAME=shoreA:10 or NAME=shore00:30")
        priors[name] = prior_of(name, what)
    names = [name.strip() for name in free.split(",") if name.strip()]
    with Stages("calibration"):
        content = calibrate_folder(load_study(config), recording, names, priors, out, laws, kept, workers)
        if page:
            from gelforge.report.calibration_page import write_calibration_page

            stage("page")
            write_calibration_page(out)
    print("\n".join(summary(content)))
    print(f"written to {out}")
