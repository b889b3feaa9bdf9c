"""Seconds from an empty environment to the first label, and to a whole study, from a wheel and nothing of the checkout.

usage: python benchmarks/installed.py [WHEEL] [--extras workflow] [--no-compile] [--folder FOLDER]

Builds the wheel of this checkout where none is named, makes an environment and a folder for the study in a temporary folder
(or in FOLDER, which stays), installs by pip's configured index, and prints the wall and CPU seconds of each step. The first
label holds the compilation of all kernels. pip's cache is not used, so packages are downloaded as on a new machine.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

import pandas as pd

ROOT = Path(__file__).parents[1]
SENSOR, MIDDLE = "gelsight_mini", ("--x", "10.375", "--y", "12.625", "--depths", "0.5")


def cpu_seconds() -> float:
    """Return the CPU time of all child processes that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


class Steps:
    """Commands one after the other, with the seconds of each."""

    def __init__(self, folder: Path):
        self.folder = folder
        self.environment = {
            key: os.environ[key] for key in os.environ if not key.startswith(("PYTHON", "VIRTUAL_ENV"))
        }
        self.environment["NUMBA_CACHE_DIR"] = str(folder / "kernels")  # none that was compiled before
        self.rows: list[tuple[str, float, float]] = []

    def run(self, name: str, *command: str | Path) -> None:
        print(f"{name}: {' '.join(map(str, command))}", flush=True)
        wall, cpu = time.monotonic(), cpu_seconds()
        done = subprocess.run(
            command,
            cwd=self.folder,
            env=self.environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        if done.returncode:
            raise SystemExit(f"{name} failed:\n{done.stdout[-4000:]}")
        self.rows.append((name, time.monotonic() - wall, cpu_seconds() - cpu))

    def table(self) -> str:
        table = pd.DataFrame(self.rows, columns=["step", "wall [s]", "CPU [s]"])
        return table.to_markdown(index=False, floatfmt=".0f")


def try_wheel(wheel: Path | None, extras: str, compiled: bool, folder: Path) -> Steps:
    """Install a wheel into an empty environment in this folder, make a label and a whole study; return the steps."""
    study, python = folder / "study", folder / "environment/bin/python"
    study.mkdir()
    steps = Steps(study)
    if wheel is None:
        steps.run(
            "the wheel",
            sys.executable,
            "-m",
            "pip",
            "wheel",
            "--quiet",
            "--no-deps",
            "--wheel-dir",
            folder,
            ROOT,
        )
        (wheel,) = folder.glob("gelforge-*.whl")
    venv.create(folder / "environment", with_pip=True)
    options = ["--quiet", "--no-cache-dir", *([] if compiled else ["--no-compile"])]
    steps.run("pip install", python, "-m", "pip", "install", *options, f"{wheel.resolve()}[{extras}]")
    gelforge = [python, "-m", "gelforge"]
    steps.run("a study of a shipped sensor", *gelforge, "init", "mine", "--sensor", SENSOR)
    steps.run(
        "the first label", *gelforge, "press", "--study", "config/mine.yaml", *MIDDLE, "--out", "label.h5"
    )
    steps.run("gelforge check", *gelforge, "check", "mine")
    steps.run("the whole study", python, "-m", "snakemake", "--cores", "2")
    for name in ("dataset/manifest.json", "report.html"):
        if not (study / "results/mine" / name).is_file():
            raise SystemExit(f"the study ended without {name}")
    return steps


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("wheel", nargs="?", type=Path)
    parser.add_argument("--extras", default="workflow", help="of the installation, with commas between")
    parser.add_argument(
        "--no-compile", action="store_true", help="pip compiles no module; Python does so when it imports one"
    )
    parser.add_argument("--folder", type=Path, help="where environment and study are made, and stay")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = (options.folder or Path(temporary)).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        steps = try_wheel(options.wheel, options.extras, not options.no_compile, folder)
    print(steps.table())
    to_label = [
        row
        for row in steps.rows
        if row[0] in ("pip install", "a study of a shipped sensor", "the first label")
    ]
    wall, cpu = (sum(row[k] for row in to_label) for k in (1, 2))
    print(f"from pip install to the first label: {wall:.0f} s, {cpu:.0f} CPU s")


if __name__ == "__main__":
    main()
