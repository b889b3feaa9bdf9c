"""`gelforge model`: a model for a shipped sensor, trained in simulation alone."""

from __future__ import annotations

import subprocess
import sys
from contextlib import chdir
from pathlib import Path

from gelforge.cli.study.shipped_sensors import sensor_files
from gelforge.cli.study.working_folder import make_runnable, write_shipped
from gelforge.config import ConfigError, load_study
from gelforge.shipped import EXAMPLES

MODELS = Path("config/models")  # one study for each sensor that has one


def model(sensor: str, out: Path | None, cores: int) -> None:
    """Build the model of a shipped sensor in a folder, or go on with what is there, and say what to run next."""
    from gelforge.cli.study.unlock import unlock

    study = model_study(sensor)
    out = out or Path(f"{sensor}_model")
    out.mkdir(parents=True, exist_ok=True)
    with chdir(out):
        unlock()
        for path in write_files(sensor):
            print(out / path)
        described = load_study(study)
        target = described.results_folder / "model" / "model.pt"
        run = [str(target), "--cores", str(cores), "--rerun-incomplete", "--configfile", str(study)]
        if subprocess.run([sys.executable, "-m", "snakemake", *run]).returncode:
            raise ConfigError(
                f"{out}: the model is not finished; what went wrong stands above, what is solved is kept: run again"
            )
    print(what_next(out, study, target))


def model_study(sensor: str) -> Path:
    """Return the study, relative to a working folder, from which a shipped sensor's model is built."""
    names = sorted(path.stem for path in (EXAMPLES / MODELS).glob("*.yaml"))
    if sensor not in names:
        raise ConfigError(
            f"no study is shipped that builds a model for {sensor!r}; there is one for {', '.join(names)}. For another "
            "sensor write a study with `synthesis` (docs/how-to/synthesis.md)"
        )
    return MODELS / f"{sensor}.yaml"


def write_files(sensor: str) -> list[Path]:
    """Write study, sensor and workflow of a sensor's model into this folder; what is there, perhaps edited, stays."""
    study = model_study(sensor)
    written = write_shipped([study, *sensor_files(sensor)])
    return [*written, *make_runnable(study.relative_to("config").with_suffix("").as_posix())]


def what_next(out: Path, file: Path, model: Path) -> str:
    """Return what was built, what it is worth, and the commands that use it."""
    return f"""
{out / model}
SYNTHETIC: trained on simulated images alone. It was never tried on real images: check its forces against known ones.

live      gelforge live 0 --model {out / model} --reference zero.png --open
camera    the images must show what {file} describes under synthesis.camera and particles: measure
          yours (docs/cameras.md), edit {out / file} and run this again
adapt     record 20 presses with a force sensor (docs/protocol.md), name the session in the study, then in {out}:
          snakemake --cores 2 labels
          gelforge adapt --study {file} --model {model} --presses 20 --out adapted.pt"""
