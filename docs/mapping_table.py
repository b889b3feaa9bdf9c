"""Keys of a material mapping as docs/material-mappings.md: `python docs/mapping_table.py` writes it."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined

from gelforge.config.foreign.mapping import (
    Column,
    Corrections,
    FromName,
    Lateral,
    Mapping,
    Rows,
    Strain,
    Stress,
    TestMapping,
    Time,
)
from gelforge.config.foreign.table_form import TableForm
from gelforge.files import write_text
from gelforge.section import Section
from gelforge.units import UNITS

PAGE = Path(__file__).parent / "material-mappings.md"
HEAD = """\
# Mappings of material tests

Written by `python docs/mapping_table.py` from `gelforge/config/foreign/mapping.py`.

A mapping is a YAML file that says what the files of a test machine hold: which column is what, in which unit and sign, and
how the table is written. It is named by a study (`materials.<material>.mapping`), by `gelforge characterise --mapping` or by
`gelforge.fit(mapping=...)`. Uniaxial tests and one in pure shear, as a German Instron writes them:

    describes: Instron Bluehill exports, Ecoflex
    common:                                    # keys of every entry below
      table: {separator: ';', decimal: ',', encoding: latin-1}
      strain: {column: Weg, unit: mm, measure: displacement}
      stress: {column: Kraft, unit: N, measure: force}
      time: {column: Zeit, unit: s}
    tests:                                     # a file is read by the first entry with a fitting pattern
      - {files: ['zug_*.csv'], kind: uniaxial, gauge_length_mm: 40, cross_section_mm2: 20.5}
      - {files: [schub_1.csv], kind: pure_shear, gauge_length_mm: 15, cross_section_mm2: 200}

`gelforge init STUDY` writes a commented one, `data/STUDY/materials/mapping.yaml`, and copies ten examples to
`config/mappings/`. What each key means, its unit or values, its default:

| key | meaning | unit or values | default | example |
|---|---|---|---|---|
"""
FOOT = """
The first four keys stand at the top of the file, those from `files` on in an entry of `tests`, or in `common`; a key with
a dot stands inside the key before the dot. A column (`strain`, `stress`, `time`, `height`, `force`, ...) has the keys
`column`, `unit` and `sign` as listed under `time`.

Units: {units}. Other spellings, such as N/mm2 or lbs, are known too.

A table of several specimens, each below the same header, is read as one specimen for each; its title names it. Curves side
by side in one table are read by entries with the same pattern. `h:mm:ss` is read as a time of day, 62:03.5 too.

Files of one name in several folders are specimens of their own, called by folder and file. Separators at the end of all
rows are ignored. A line of units below the header is recognised and compared with the declared units. What is odd (a toe, a
slack, repeated stamps, a declared rate that the columns contradict, specimens that differ by more than their noise) is
reported, and corrected only where `corrections` asks for it.
"""

# Where the keys stand in the file, and the section that declares them.
SECTIONS: tuple[tuple[str, type[Section]], ...] = (
    ("", Mapping),
    ("tests.", TestMapping),
    ("table.", TableForm),
    ("rows.", Rows),
    ("time.", Time),  # with the keys of every column
    ("strain.", Strain),
    ("stress.", Stress),
    ("lateral.", Lateral),
    ("from_name.", FromName),
    ("corrections.", Corrections),
)
EXAMPLES = {
    "describes": "Instron Bluehill exports, Ecoflex",
    "ignore": "[README*, '*_raw.csv']",
    "common": "{material: ecoflex}",
    "tests": "[{files: ['*.csv'], kind: uniaxial, ...}]",
    "tests.files": "['zug_*.csv']",
    "tests.optional": "true",
    "tests.kind": "pure_shear",
    "tests.history": "cyclic",
    "tests.table": "{separator: ';', decimal: ','}",
    "tests.rows": "[{column: Cycle, equals: [1]}]",
    "tests.material": "ecoflex",
    "tests.strain": "{column: Weg, unit: mm, measure: displacement}",
    "tests.stress": "{column: Kraft, unit: N, measure: force}",
    "tests.lateral": "{strain: {column: stretch_2, measure: stretch}}",
    "tests.time": "{column: Zeit, unit: s}",
    "tests.radius": "{column: R, unit: mm}",
    "tests.height": "{column: z, unit: um, sign: -1}",
    "tests.force": "{column: F, unit: nN}",
    "tests.force_2": "{column: Right, unit: gf}",
    "tests.rate": "{column: rate, unit: 1/s}",
    "tests.temperature": "{column: T, unit: C}",
    "tests.also": "[{column: True strain, measure: 'true'}]",
    "tests.split": "specimen",
    "tests.segment": "Step",
    "tests.from_name": "{pattern: '(?P<sample>s[0-9]+)_.*'}",
    "tests.gauge_length_mm": "40",
    "tests.cross_section_mm2": "20.5",
    "tests.thickness_mm": "1.5",
    "tests.ball_radius_mm": "3",
    "tests.layer_thickness_mm": "4",
    "tests.rigid_board": "board.csv",
    "tests.spring_constant_N_per_m": "0.06",
    "tests.rate_per_s": "0.01",
    "tests.age_days": "28",
    "tests.temperature_C": "23",
    "tests.plausible_shear_modulus_kPa": "[5, 200]",
    "tests.plausible_stiffness_N_per_m": "[1.0e-4, 6.0e-2]",
    "tests.plausible_force_N": "[5, 200]",
    "tests.corrections": "{toe: remove}",
    "table.separator": "';'",
    "table.decimal": "','",
    "table.thousands": "','",
    "table.encoding": "latin-1",
    "table.comment": "'#'",
    "table.skip_rows": "3",
    "table.header": "false",
    "table.header_begins_with": "'Zeit'",
    "table.units_row": "true",
    "table.columns": "4",
    "rows.column": "Cycle",
    "rows.equals": "[1]",
    "rows.at_least": "0.05",
    "rows.at_most": "10",
    "strain.measure": "displacement",
    "stress.measure": "force",
    "stress.at": "{column: stretch_2, measure: stretch}",
    "time.column": "Zeit",
    "time.unit": "ms",
    "time.sign": "-1",
    "time.restarts_with": "segment",
    "lateral.strain": "{column: stretch_2, measure: stretch}",
    "lateral.extension_ratio": "0.5",
    "lateral.stress": "{column: P22, unit: kPa, measure: nominal}",
    "from_name.pattern": "'(?P<sample>s[0-9]+)_(?P<age_days>[0-9]+)d'",
    "from_name.decimal": "d",
    "corrections.toe": "remove",
    "corrections.zero_force": "true",
    "corrections.zero_strain": "true",
    "corrections.time": "sort",
    "corrections.odd_rows": "keep",
    "corrections.unsorted": "sort",
    "corrections.after_fall": "cut",
    "corrections.repeated_time": "average",
}


def keys() -> Iterator[tuple[str, FieldInfo]]:
    """Yield every key of a mapping, with the section in front of its name, and its field."""
    for prefix, section in SECTIONS:
        for name, field in section.model_fields.items():
            if section not in (Strain, Stress) or name not in Column.model_fields:
                yield prefix + name, field


def page() -> str:
    """Return the whole page: a row per key."""
    return HEAD + "".join(row(*one) for one in keys()) + FOOT.format(units=", ".join(UNITS))


def row(key: str, field: FieldInfo) -> str:
    """Return a key's line of the table."""
    meaning = field.description or ""
    unit = ""
    if meaning.endswith("]"):  # a unit at the end of the description
        meaning, _, unit = meaning[:-1].rpartition(" [")
    cells = (
        f"`{key.removeprefix('tests.')}`",
        meaning,
        values(field.annotation) + (f" [{unit}]" if unit else ""),
        default(field),
        f"`{EXAMPLES[key]}`",
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |\n"


def values(kind: Any) -> str:
    """Return in words what a field may be."""
    if get_origin(kind) is Literal:
        return ", ".join(f"`{value}`" for value in get_args(kind))
    if isinstance(kind, type) and issubclass(kind, Column):
        return "a column"
    if isinstance(kind, type) and issubclass(kind, Section):
        return "keys"
    if kind in (bool, int, float, str):
        return {bool: "true, false", int: "whole number", float: "number", str: "text"}[kind]
    inner = [part for part in get_args(kind) if part is not type(None)]
    if get_origin(kind) is dict:
        return "keys"
    if get_origin(kind) is list:
        return f"list of {values(inner[0]).replace('a column', 'columns')}"
    if get_origin(kind) is tuple:
        return "two numbers"
    return values(inner[0]) if inner else "text"


def default(field: FieldInfo) -> str:
    """Return the default of a field as a file would state it."""
    value = field.default
    if value is PydanticUndefined:
        return "required"
    if value is None or value in ([], {}) or isinstance(value, Section):
        return ""
    if isinstance(value, list | tuple):
        return f"`[{', '.join(part if isinstance(part, str) else f'{part:g}' for part in value)}]`"
    return f"`{str(value).lower() if isinstance(value, bool) else value}`"


if __name__ == "__main__":
    write_text(PAGE, page())
