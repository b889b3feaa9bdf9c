"""The layers of the package: imports run one way, and heavy libraries stay where they belong."""

import ast
import subprocess
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import gelforge

PACKAGE = Path(gelforge.__file__).parent

# A module may import from its own layer and from lower ones. Folders of one layer do not import each other.
LAYERS = [
    {"registry", "section", "robust"},
    {"mechanics"},
    {"meshing"},
    {"config", "files", "hdf5", "csv_table", "units", "input_files", "progress", "workers", "shipped"},
    {"materials", "indentation", "verification"},
    {"interpolation", "laws_of_study"},
    {"recording", "virtual_lab"},
    {"dataset", "importing"},
    {"synthesis"},
    {"learning"},
    {"mismatch", "live"},
    {"calibration"},
    {"report"},
    {"api"},
    {"cli", "__main__"},
    {"workflow"},
]
# The rooms of a large part, in the same manner; what stands in the part's own folder may import all of them, but a module
# that is named here is imported by rooms itself.
ROOMS = {
    "mechanics": ("laws", "meshes", "linear", "bodies", "indenters", "contact", "solving", "sensitivities"),
    "mismatch": (
        *("thresholds", "readings", "model", "result", "effects", "evidence", "free_forms", "inference"),
        *("fem", "images", "summary", "material", "pipeline"),
    ),
    "config": ("basis", "parts", "sessions", "studies", "foreign"),
    "indentation": ("sensor", "paths", "effects", "cells", "planning", "solving"),
    "recording": ("tables", "imaging", "optics", "plausibility"),
    "learning": ("basis", "elasticity", "networks", "models", "training", "judging", "deployment"),
    "materials": ("basis", "imaging", "plausibility", "small_tests", "readers", "covariates", "fitting"),
    "report": ("figures", "chapters", "verdict"),
    "cli": (
        *("values", "shared_arguments", "commands", "workflow_commands", "arguments", "tables", "extras"),
        *("products", "camera", "study", "by_hand", "model", "jobs"),
    ),
}
# The virtual lab draws what the recording stage reads, and judges nothing: it may use the camera and the session's files.
SIDEWAYS = {("virtual_lab", "recording")}

CONFINED = {
    "cv2": {"materials", "importing", "recording", "virtual_lab"},
    "torch": {"learning"},
    "onnxruntime": {"learning"},
    "websockets": {"live"},
    "yaml": {"config"},
    "matplotlib": {"report"},
    "snakemake": set(),
    "pytetwild": {"meshing"},
    "meshio": {"meshing", "indentation"},
}
MECHANICS_KNOWS = {
    "numpy",
    "scipy",
    "numba",
    "llvmlite",
    "pypardiso",
    "pydantic",
}  # pydantic: parameters as given


def layer_of(part: str) -> int:
    return next(number for number, names in enumerate(LAYERS) if part in names)


def imported(source: str) -> set[str]:
    """Return the full names of everything a module imports, at its top or inside a function."""
    names = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def complaints(part: str, source: str) -> list[str]:
    """Return what a module of this part of the package imports and must not."""
    found = []
    for name in sorted(imported(source)):
        root = name.split(".")[0]
        if root == "gelforge":
            target = name.partition(".")[2].split(".")[0]
            if target in ("", "__version__", part):  # the package itself: its version and its place
                continue
            upward = layer_of(target) > layer_of(part)
            sideways = layer_of(target) == layer_of(part) and layer_of(part) != layer_of("config")
            if upward or (sideways and (part, target) not in SIDEWAYS and part != "__main__"):
                found.append(f"{part} imports {name}, which is not below it")
        elif root in CONFINED and part not in CONFINED[root]:
            found.append(
                f"{part} imports {root}, which belongs to {sorted(CONFINED[root]) or 'the workflow'}"
            )
        elif part == "mechanics" and root not in MECHANICS_KNOWS | sys.stdlib_module_names:
            found.append(f"mechanics imports {root}; it knows {sorted(MECHANICS_KNOWS)} only")
    return found


MODULES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def test_modules_and_rooms_import_what_is_below_them():
    # Imports run one way. One test of all modules: a case for each would cost more than what it looks at
    assert len(MODULES) > 200  # the package has been found
    found = [
        f"{path.relative_to(PACKAGE).as_posix()}: {words}"
        for path in MODULES
        for words in complaints(
            path.relative_to(PACKAGE).parts[0].removesuffix(".py"), path.read_text(encoding="utf-8")
        )
    ]
    assert found == []

    # Rooms import what is below them
    found, seen = [], set()
    for path in MODULES:
        part, *inner = path.relative_to(PACKAGE).parts
        room = inner[0].removesuffix(".py") if inner else ""
        if part in ROOMS and (len(inner) > 1 or room in ROOMS[part]):
            seen.add((part, room))
            found += [f"{path.name}: {words}" for words in upward(part, room, path.read_text("utf-8"))]
    assert found == []
    assert seen == {(part, room) for part, rooms in ROOMS.items() for room in rooms}
    assert upward("mismatch", "readings", "from gelforge.mismatch.evidence.screen import Candidate")


def upward(part: str, room: str, source: str) -> list[str]:
    """Return what a module in a room imports of its part that is not below it."""
    rooms = ROOMS[part]
    inside = [name.split(".")[2] for name in imported(source) if name.startswith(f"gelforge.{part}.")]
    allowed = rooms[: rooms.index(room) + 1]
    return [f"{part}/{room} imports {part}.{name}" for name in sorted(set(inside)) if name not in allowed]


def circle(sources: dict[str, str]) -> list[str]:
    """Return modules that import each other in a circle as they are loaded, of sources by name; none: an empty list."""
    needs: dict[str, set[str]] = {}
    for name, source in sources.items():
        top = [node for node in ast.parse(source).body if isinstance(node, ast.Import | ast.ImportFrom)]
        found = imported(ast.unparse(ast.Module(top, [])))
        # of `from module import function` the module counts
        needs[name] = {full if full in sources else full.rpartition(".")[0] for full in found} & set(sources)
    try:
        TopologicalSorter(needs).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_no_modules_import_each_other_and_references_stand_alone():
    # No modules import each other. What a function imports as it runs, and what types alone need, may point back
    named = {
        ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__"): path
        for path in MODULES
    }
    assert circle({name: path.read_text(encoding="utf-8") for name, path in named.items()}) == []
    assert circle({"a.b": "from a.c import f", "a.c": "import a.b"}) in (
        ["a.b", "a.c", "a.b"],
        ["a.c", "a.b", "a.c"],
    )

    # Reference solutions stand alone. Closed forms judge the package, so they import nothing of it (architecture:
    # imports)
    closed_forms = list((PACKAGE / "mechanics").rglob("*reference*.py"))
    assert closed_forms
    for path in closed_forms:
        assert not [name for name in imported(path.read_text()) if name.startswith("gelforge")]


@pytest.mark.parametrize(
    ("part", "source"),
    [
        ("mechanics", "from gelforge.config import Study"),
        ("indentation", "from gelforge.recording.optics.camera import project"),
        ("indentation", "from gelforge.materials import fits"),
        ("dataset", "def f():\n    import gelforge.learning.models.model_file"),
        ("dataset", "import torch"),
        ("report", "import cv2"),
        ("learning", "from matplotlib.figure import Figure"),
        ("mechanics", "import pandas"),
        ("cli", "import snakemake"),
    ],
)
def test_an_import_that_runs_upward_is_found(part, source):
    assert len(complaints(part, source)) == 1


def test_help_imports_nothing_heavy():
    """`gelforge --help` answers at once: no numerical library is loaded for it."""
    code = "import sys; from gelforge.cli.arguments import parser; parser(); print(*sys.modules)"
    loaded = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert not {"numpy", "pydantic", "torch", "cv2", "matplotlib", "numba", "h5py", "pandas"} & set(loaded)
