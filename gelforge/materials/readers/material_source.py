"""What was measured on a material: its tests in folders or files, in the project's format or as a mapping declares."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

from gelforge.config.foreign.mapping import Mapping, load_mapping
from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import ForcePair, IndentationTest, MaterialTest
from gelforge.materials.plausibility.odd_rows import check_copies
from gelforge.materials.readers.mapped_files import Read, read_by_all, read_mapped, read_mapped_folder
from gelforge.materials.readers.material_tests import declared_synthetic, input_files, read_material_tests
from gelforge.materials.readers.small_files import press_files, read_press, read_small_tests
from gelforge.materials.small_tests.small_effects import Press, SmallTests
from gelforge.materials.small_tests.trials import FRICTION, THICKNESS, sheet_thickness, static_friction


@dataclass(frozen=True)
class MaterialSource:
    """The tests of one material, the files they came from, and whether these say that they are synthetic."""

    name: str
    tests: tuple[MaterialTest, ...] = ()
    files: tuple[Path, ...] = ()
    synthetic: bool = False
    small: SmallTests = field(default_factory=SmallTests)
    study: str = ""  # for which its laws are fitted; empty: by hand

    def __add__(self, other: MaterialSource) -> MaterialSource:
        """Return what is known from both."""
        small = SmallTests(
            self.small.friction or other.small.friction,
            self.small.thickness | other.small.thickness,
            self.small.presses + other.small.presses,
            self.small.force_pairs + other.small.force_pairs,
        )
        files, synthetic = (
            tuple(dict.fromkeys((*self.files, *other.files))),
            self.synthetic or other.synthetic,
        )
        return replace(self, tests=self.tests + other.tests, files=files, synthetic=synthetic, small=small)


def read_sources(sources: list[Path], mapping: Path | None = None) -> list[MaterialSource]:
    """Return the materials found in folders and files, in the order of their names.

    Parameters
    ----------
    sources : list of Path
        Folders and files of material tests.
    mapping : Path, optional
        YAML that says what the columns of any table mean; without it folders with samples.csv or small tests are read.

    Returns
    -------
    list of MaterialSource
        Tests, small tests and files of each material.

    Raises
    ------
    TableError
        For a table that cannot be read or cannot be true. The message names file, row, value and remedy.
    """
    declared = load_mapping(mapping) if mapping else None
    materials: dict[str, MaterialSource] = {}
    for source in map(Path, sources):
        folder = source if source.is_dir() else source.parent
        for material in _read(source, declared):
            material = material if len(sources) == 1 else _below(folder, material)
            known = materials.get(material.name)
            materials[material.name] = known + material if known else material
    materials = {name: replace(m, tests=_distinct(m.tests)) for name, m in materials.items()}
    for name, material in materials.items():
        check_copies(name, material.tests)
    if mapping:
        materials = {name: replace(m, files=(*m.files, Path(mapping))) for name, m in materials.items()}
    return [materials[name] for name in sorted(materials)]


def source_of(name: str, folder: Path, mapping: Path | None = None) -> MaterialSource:
    """Return the one material of a study in a folder: the only one there, or the one of that name.

    Parameters
    ----------
    name : str
        Of the material in the study.
    folder : Path
        Of its tests.
    mapping : Path, optional
        As of `read_sources`.

    Returns
    -------
    MaterialSource
        Under the study's name.

    Raises
    ------
    TableError
        Where the folder holds several materials and none of that name, and as `read_sources`.
    """
    materials = read_sources([folder], mapping)
    chosen = materials if len(materials) == 1 else [m for m in materials if m.name == name]
    if not chosen:
        raise TableError(
            f"{folder}: holds the materials {[m.name for m in materials]}, none is called {name!r}; name the study's"
            " material as one of them, or give each a folder"
        )
    return replace(chosen[0], name=name)


def source_files(folder: Path, mapping: Path | None = None) -> list[Path]:
    """Return every file that decides a material's results."""
    if mapping is None:
        return input_files(folder)
    return [mapping, *(path for path in sorted(Path(folder).rglob("*")) if path.is_file())]


def _distinct(tests: tuple[MaterialTest, ...]) -> tuple[MaterialTest, ...]:
    """Return the tests with the file's name, then its folder, added to samples that would share a name.

    Raises TableError for samples that are the same even so: a file that was named twice.
    """
    for longer in (_with_file, _with_folder):
        names = Counter(map(_name, tests))
        tests = tuple(replace(t, sample=longer(t)) if names[_name(t)] > 1 else t for t in tests)
    names = Counter(map(_name, tests))
    twice = next((t for t in tests if names[_name(t)] > 1), None)
    if twice:
        what = f"the {twice.test} sample {twice.sample!r}"
        raise TableError(f"{twice.source}: {what} is read twice; name each file or folder once")
    return tests


def _name(test: MaterialTest) -> tuple:
    return test.test, test.sample, test.cycle


def _with_file(test: MaterialTest) -> str:
    stem = Path(test.source).stem
    return test.sample if stem == test.sample else f"{test.sample}_{stem}"


def _with_folder(test: MaterialTest) -> str:
    folder = Path(test.source).parent.as_posix()
    return test.sample if folder == "." else f"{folder}/{test.sample}"


def _below(folder: Path, material: MaterialSource) -> MaterialSource:
    """Return a material whose tests name their files with the folder: several sources may have files of one name."""
    tests = tuple(replace(t, source=(folder / t.source).as_posix()) for t in material.tests)
    return replace(material, tests=tests)


def _read(source: Path, mapping: Mapping | None) -> list[MaterialSource]:
    if not source.exists():
        raise TableError(f"{source}: no such file or folder; name one that exists")
    if mapping is None and source.is_dir():
        tests, files = tuple(read_material_tests(source)), tuple(input_files(source))
        return [
            MaterialSource(source.name, tests, files, declared_synthetic(source), read_small_tests(source))
        ]
    if mapping is None:
        return [_small_file(source)]
    if source.is_dir():
        return [_mapped(test, source.name, source, mapping) for test in read_mapped_folder(source, mapping)]
    entries = mapping.entries_for(source.name)
    if not entries:
        raise TableError(f"{source}: the mapping ignores this file; name a test, or change `ignore`")
    return [_mapped(test, source.stem, source.parent, mapping) for test in read_by_all(source, entries)]


def _small_file(path: Path) -> MaterialSource:
    """Return a small test in the project's format: friction.csv, thickness.csv, or an indentation with its sidecar."""
    files = [path]
    if path.name == FRICTION:
        small = SmallTests(friction=static_friction(path))
    elif path.name == THICKNESS:
        small = SmallTests(thickness=sheet_thickness(path))
    elif path.with_suffix(".yaml").is_file():
        small, files = SmallTests(presses=(read_press(path),)), press_files(path)
    else:
        raise TableError(
            f"{path}: a single file needs a mapping that says what its columns are; give --mapping (in Python mapping=)"
        )
    return MaterialSource(path.resolve().parent.name, files=tuple(files), small=small)


def _mapped(test: Read, otherwise: str, folder: Path, mapping: Mapping) -> MaterialSource:
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", getattr(test, "material", "") or otherwise)  # a folder's name
    files = (folder / test.source,)
    if isinstance(test, IndentationTest):
        board, more = _board(test, folder, mapping)
        press = Press(test, test.layer_thickness_mm, board)
        return MaterialSource(name, files=(*files, *more), small=SmallTests(presses=(press,)))
    if isinstance(test, ForcePair):
        return MaterialSource(name, files=files, small=SmallTests(force_pairs=(test,)))
    return MaterialSource(name, (test,), files)


def _board(
    test: IndentationTest, folder: Path, mapping: Mapping
) -> tuple[IndentationTest | None, list[Path]]:
    """Return the test on a rigid board that a mapping names for an indentation, and its file; none for the board itself."""
    if test.rigid_board is None or test.is_the_board:
        return None, []
    neighbour = (folder / test.source).with_name(test.rigid_board)
    boards = [path for path in (neighbour, *sorted(folder.rglob(test.rigid_board))) if path.is_file()]
    entry = mapping.entry_for(test.rigid_board)
    if not boards or entry is None:
        raise TableError(
            f"{folder / test.source}: rigid_board {test.rigid_board!r} is {'ignored' if boards else 'not there'}; name the"
            " file of an indentation that the mapping reads"
        )
    board = read_mapped(boards[0], entry)[0]
    if not isinstance(board, IndentationTest):
        found = f"the mapping reads it as {entry.kind}, not as an indentation"
        raise TableError(f"{boards[0]}: named as rigid_board, but {found}")
    return board, boards[:1]
