"""What `gelforge init` writes for the files of a test machine: a commented mapping, and the examples that are shipped."""

from __future__ import annotations

from pathlib import Path

from gelforge.shipped import EXAMPLES

EXAMPLE_MAPPINGS = Path("config/mappings")
TEMPLATE = """\
# What the files of your test machine hold; `samples.csv` is not needed then. All keys: docs/material-mappings.md; other
# examples: config/mappings/. Name this file in config/{study}.yaml, instead of `parameters` or next to `tests`:
#   materials:
#     gel: {{tests: data/{study}/materials/gel, mapping: {path}}}
# and try it: gelforge characterise data/{study}/materials/gel --mapping {path} --out results/{study}/try
describes: my test machine # in words
common: # keys of every entry below
  table: {{separator: ',', decimal: '.'}} # also ';', tab, space; encoding: latin-1, header_begins_with: 'Time', skip_rows: 3
  strain: {{column: Extension, unit: mm, measure: displacement}} # or stretch, engineering, true
  stress: {{column: Load, unit: N, measure: force}} # or nominal, cauchy with unit: kPa
  time: {{column: Time, unit: s}}
tests: # a file is read by the first entry with a pattern that fits its name
  - files: ['tension_*.csv']
    kind: uniaxial # or compression, pure_shear, equibiaxial, biaxial, simple_shear, indentation
    gauge_length_mm: 40 # undeformed length between the clamps
    cross_section_mm2: 20 # undeformed width times thickness
  - files: ['shear_*.csv']
    kind: pure_shear
    optional: true # no such file need be there
    gauge_length_mm: 15
    cross_section_mm2: 200
"""


def mapping_files(study: str) -> dict[Path, str]:
    """Return the commented mapping of a new study with its text, by path."""
    path = Path("data") / study / "materials" / "mapping.yaml"
    return {path: TEMPLATE.format(study=study, path=path.as_posix())}


def example_mappings() -> list[Path]:
    """Return the paths of the shipped mappings."""
    return [path.relative_to(EXAMPLES) for path in sorted((EXAMPLES / EXAMPLE_MAPPINGS).glob("*.yaml"))]
