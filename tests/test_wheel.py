"""The wheel in an environment that has what it asks for and nothing else, in a folder with nothing of the checkout."""

import os
import re
import shutil
import subprocess
import sys
import tomllib
import venv
from importlib.metadata import distributions, packages_distributions, requires
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

import gelforge
from gelforge.cli.extras import EXTRAS

ROOT = Path(__file__).parents[1]
SOURCES = ("gelforge", "workflow", "config", "data", "pyproject.toml", "setup.py", "README.md", "LICENSE")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
# A finder that finds none of these; `None` in sys.modules would be taken for a module by SciPy.
HIDING = """
import sys

HIDDEN = set({hidden})


class Hiding:
    def find_spec(name, path=None, target=None):
        if name.partition(".")[0] in HIDDEN:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)


sys.meta_path.insert(0, Hiding)
"""


def called(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def needed(lines: list[str], extras: set[str]) -> set[str]:
    """Return the distributions, installed here, that these requirements bring, those of requirements among them."""
    found, front = set(), [(line, extras) for line in lines]
    while front:
        line, wanted = front.pop()
        asked = Requirement(line)
        if asked.marker and not any(asked.marker.evaluate({"extra": extra}) for extra in wanted | {""}):
            continue
        if (key := (called(asked.name), frozenset(asked.extras))) not in found:
            found.add(key)
            front += [(more, asked.extras) for more in requires(asked.name) or []]
    return {name for name, _ in found}


class Installed:
    """An environment with the wheel, where packages that it does not ask for cannot be imported."""

    def __init__(self, folder: Path, wheel: Path):
        venv.create(folder, symlinks=True)
        self.python = folder / "bin" / "python"
        self.site = next((folder / "lib").glob("python*/site-packages"))
        pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-compile"]
        subprocess.run([*pip, "--target", str(self.site), str(wheel)], check=True)
        metadata = next(self.site.glob("gelforge-*.dist-info"))
        self.requirements = [
            line.removeprefix("Requires-Dist: ")
            for line in (metadata / "METADATA").read_text().splitlines()
            if line.startswith("Requires-Dist: ")
        ]

    def with_extras(self, *extras: str) -> None:
        """Let what the wheel and these extras ask for be imported from the tests' own environment, and nothing else."""
        allowed = needed(self.requirements, set(extras)) | {"gelforge"}
        hidden = [
            name
            for name, owners in packages_distributions().items()
            if not {called(owner) for owner in owners} & allowed and name not in sys.stdlib_module_names
        ]
        (self.site / "hidden_packages.py").write_text(HIDING.format(hidden=sorted(hidden)))
        others = next(distributions(name="numpy")).locate_file("")
        (self.site / "others.pth").write_text(f"import hidden_packages\n{others}\n")

    def run(self, *arguments: str, folder: Path) -> subprocess.CompletedProcess:
        environment = {key: os.environ[key] for key in os.environ if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
        return subprocess.run(
            [str(self.python), "-m", *arguments], cwd=folder, env=environment, capture_output=True, text=True
        )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    source, folder = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    for name in SOURCES:  # a build leaves folders behind, and takes up those of an earlier one
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(ROOT / name, source)
    build = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    subprocess.run([*build, "--wheel-dir", str(folder), str(source)], check=True)
    [found] = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def installed(tmp_path_factory, wheel) -> Installed:
    return Installed(tmp_path_factory.mktemp("environment"), wheel)


def test_a_study_is_begun_and_its_workflow_planned_without_the_checkout(installed, tmp_path):
    installed.with_extras("workflow")  # PyTorch is for the jobs that train
    where = installed.run("gelforge", "examples", folder=tmp_path)
    assert where.returncode == 0, where.stderr
    planned = installed.run(
        "snakemake", "-n", "--quiet", "rules", "--configfile", "config/test.yaml", folder=tmp_path
    )
    assert planned.returncode == 0, planned.stdout + planned.stderr
    jobs = dict(line.split() for line in planned.stdout.splitlines() if re.fullmatch(r"\w+ +\d+", line))
    assert jobs["simulate"] == "3" and jobs["all"] == "1"


@pytest.mark.thorough
def test_a_whole_study_of_a_shipped_sensor_runs_without_the_checkout(installed, tmp_path):
    """One coarse site of a GelSight Mini, from `gelforge init` to the report; kernels are compiled, a minute."""
    installed.with_extras("workflow")
    assert (
        installed.run("gelforge", "init", "mine", "--sensor", "gelsight_mini", folder=tmp_path).returncode
        == 0
    )
    config = tmp_path / "config/mine.yaml"
    study = yaml.safe_load(config.read_text()) | {"verification": []}
    study["plan"] = {"grid": {"spacing_mm": 5.0, "margin_mm": 10.0}, "depths_mm": [0.5]}
    study["mechanics"]["mesh"] = {"near_mm": 1.5, "near_radius_mm": 2.0, "far_mm": 3.0}
    config.write_text(yaml.safe_dump(study))
    ran = installed.run("snakemake", "--cores", "1", folder=tmp_path)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "Traceback" not in ran.stdout + ran.stderr  # the jobs are forks, also of what an extra would bring
    for name in ("dataset/manifest.json", "tables/force_ranges.csv", "report.html"):
        assert (tmp_path / "results/mine" / name).is_file()


def test_commands_without_extras_name_the_one_that_they_lack(installed, tmp_path):
    installed.with_extras()
    assert installed.run("gelforge", "init", "mine", folder=tmp_path).returncode == 0
    at = ["--x", "16", "--y", "16", "--depth", "1", "--out", "mesh.vtu"]
    meshed = installed.run(
        "gelforge", "mesh", *at, folder=tmp_path
    )  # of the article's sensor, from the examples
    assert meshed.returncode == 0, meshed.stderr
    lacking = installed.run("gelforge", "export", "--model", "m.pt", "--out", "m.onnx", folder=tmp_path)
    assert lacking.returncode == 1
    assert lacking.stderr == (
        'gelforge: torch is not installed; it comes with: pip install "gelforge[learning]"\n'
    )


def test_one_version_everywhere_and_extras_are_those_of_the_installation():
    # One version everywhere. The tags of this commit among them, where this is a clone
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == gelforge.__version__
    assert f"\n## {gelforge.__version__} " in (ROOT / "CHANGELOG.md").read_text()
    tags = subprocess.run(
        ["git", "tag", "--points-at", "HEAD", "v*.*.*"], cwd=ROOT, capture_output=True, text=True
    )
    assert set(tags.stdout.split()) <= {f"v{gelforge.__version__}"}

    # Extras are those of the installation
    module = {"scikit-learn": "sklearn"}
    optional = PROJECT["optional-dependencies"]
    for extra, brings in EXTRAS.items():
        names = {Requirement(line).name for line in optional[extra]} - {"gelforge"}
        assert set(brings) <= {module.get(name, name.replace("-", "_")) for name in names}, extra
