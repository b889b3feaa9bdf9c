"""Forms of tables: stacked specimens, curves side by side, thousands, times of a clock, UTF-16."""

import re

import numpy as np
import pytest
import yaml

from gelforge.config import ConfigError
from gelforge.config.foreign.mapping import load_mapping
from gelforge.csv_table import TableError
from gelforge.materials.readers.material_source import read_sources

LAM = np.linspace(1.0, 1.8, 41)
KINDS = {"uniaxial": LAM - LAM**-2, "pure_shear": LAM - LAM**-3, "equibiaxial": LAM - LAM**-5}
COLUMNS = {
    "time": {"column": "Time", "unit": "s"},
    "strain": {"column": "Weg", "unit": "mm", "measure": "displacement"},
    "stress": {"column": "Kraft", "unit": "mN", "measure": "force"},
    "gauge_length_mm": 2500,
    "cross_section_mm2": 2000,
}


def rows(scale=1.0, signs=str, clock=str):
    force = 1e3 * 2000 * 0.05 * scale * KINDS["uniaxial"]  # mN
    return [
        [clock(k), signs(f"{2500 * (lam - 1):.1f}"), signs(f"{f:.1f}")]
        for k, (lam, f) in enumerate(zip(LAM, force))
    ]


def read_all(folder, entries, **files):
    for name, content in files.items():
        data = content if isinstance(content, bytes) else content.encode()
        (folder / f"{name}.csv").write_bytes(data)
    mapping = {"describes": "made here", "ignore": ["*.yaml"], "tests": entries}
    (folder / "mapping.yaml").write_text(yaml.safe_dump(mapping))
    return read_sources([folder], folder / "mapping.yaml")[0].tests


def one(folder, text, **changes):
    return read_all(folder, [{"files": ["*.csv"], "kind": "uniaxial", **COLUMNS, **changes}], a=text)


def table(cells, separator=",", quote='"'):
    lines = [["Time", "Weg", "Kraft"], *cells]
    return "\n".join(separator.join(f"{quote}{cell}{quote}" for cell in line) for line in lines) + "\n"


def assert_right(test, scale=1.0):
    np.testing.assert_allclose(test.stretch, LAM, atol=1e-4)
    np.testing.assert_allclose(test.nominal_stress, 0.05 * scale * KINDS["uniaxial"], atol=1e-5)


def grouped(between, decimal="."):
    return lambda text: f"{float(text):,.1f}".replace(",", "T").replace(".", decimal).replace("T", between)


@pytest.mark.parametrize(
    ("form", "between"),
    [
        ({"thousands": ","}, ","),
        ({"thousands": ".", "decimal": ",", "separator": ";"}, "."),
        ({"thousands": "'", "decimal": ".", "separator": ";"}, "'"),
        ({"thousands": "'", "decimal": ".", "separator": ";"}, "\u2019"),
        ({"thousands": " ", "decimal": ",", "separator": ";"}, "\u202f"),
        ({"thousands": " ", "decimal": ",", "separator": ";"}, "\u2009"),
    ],
)
def test_thousands_are_read_where_declared_and_named_where_not(tmp_path, form, between):
    text = table(rows(signs=grouped(between, form.get("decimal", "."))), form.get("separator", ","))
    (test,) = one(tmp_path, text, table=form)
    assert_right(test)
    plain = {key: value for key, value in form.items() if key != "thousands"}
    with pytest.raises(TableError, match="a finite number is needed: for thousands separators set") as error:
        one(tmp_path, text, table=plain)
    remedy = yaml.safe_load(re.search("`(table: .*?})`", str(error.value)).group(1))
    assert_right(one(tmp_path, text, table=plain | remedy["table"])[0])


@pytest.mark.parametrize("cell", ["1,00.0", "10,00", "1,0000", "1,000,00", ",100", "1,000.0,0"])
def test_groups_of_other_than_three_digits_are_no_number(tmp_path, cell):
    cells = rows(signs=grouped(","))
    cells[20][1] = cell
    with pytest.raises(TableError, match="row 22: Weg is"):
        one(tmp_path, table(cells), table={"thousands": ","})


def test_one_sign_for_decimals_and_thousands_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="both ','"):
        one(tmp_path, "", table={"decimal": ",", "separator": ";", "thousands": ","})


@pytest.mark.parametrize(
    "clock",
    [
        lambda k: f"{(3590 + 7 * k) // 3600}:{(3590 + 7 * k) // 60 % 60:02d}:{(3590 + 7 * k) % 60:02d}.25",
        lambda k: f"{(3590 + 7 * k) // 60}:{(3590 + 7 * k) % 60:02d}.25",
    ],
)
def test_times_of_a_clock(tmp_path, clock):
    text = table(rows(clock=clock))
    (test,) = one(tmp_path, text, time={"column": "Time", "unit": "h:mm:ss"})
    np.testing.assert_allclose(test.time_s - test.time_s[0], 7.0 * np.arange(41))
    assert test.time_s[0] == pytest.approx(3590.25)
    with pytest.raises(TableError, match="Time is .*set the column's unit to h:mm:ss"):
        one(tmp_path, text)
    named = text.replace("Time", "Time (s)", 1)
    (again,) = one(tmp_path, named, time={"column": "Time (s)", "unit": "h:mm:ss"})
    np.testing.assert_array_equal(again.time_s, test.time_s)
    with pytest.raises(TableError, match=r"'Time \(N\)' says N, the mapping declares h:mm:ss"):
        one(tmp_path, text.replace("Time", "Time (N)", 1), time={"column": "Time (N)", "unit": "h:mm:ss"})
    broken = rows(clock=clock)
    broken[1][0] = "1:61:00"
    with pytest.raises(TableError, match=r"row 3: Time is '1:61:00'; a time h:mm:ss"):
        one(tmp_path, table(broken), time={"column": "Time", "unit": "h:mm:ss"})


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "utf-8-sig"])
def test_the_mark_of_a_file_decides_its_encoding(tmp_path, encoding):
    assert_right(one(tmp_path, table(rows()).encode(encoding))[0])


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be", "cp1252"])
def test_an_encoding_without_a_mark_names_the_key(tmp_path, encoding):
    content = ("Größe\n" if encoding == "cp1252" else "") + table(rows())
    with pytest.raises(TableError, match=f"encoding: {encoding}"):
        one(tmp_path, content.encode(encoding))
    assert_right(one(tmp_path, content.encode(encoding), table={"encoding": encoding})[0])


def test_a_clock_counts_on_past_midnight(tmp_path):
    clock = [
        f"{(86390 + k) // 3600 % 24}:{(86390 + k) // 60 % 60:02d}:{(86390 + k) % 60:02d}" for k in range(41)
    ]
    text = table(rows(clock=clock.__getitem__))
    (test,) = one(tmp_path, text, time={"column": "Time", "unit": "h:mm:ss"})
    np.testing.assert_allclose(np.diff(test.time_s), 1.0)


@pytest.mark.parametrize(
    "above",
    [
        lambda k: f"Specimen {k}\n",
        lambda k: f"\n\nProbe {k};x\nWidth,20\n",
        lambda k: f'"Probe {k}",,\n',
        lambda k: "" if k == 1 else "\n",
    ],
)
@pytest.mark.parametrize("units", ["", "s,mm,mN\n"])
def test_specimens_below_each_other_in_one_file(tmp_path, above, units):
    stacked = "".join(
        above(k) + table(rows(1 + 0.1 * k), quote="").replace("\n", "\n" + units, 1) for k in (1, 2, 3)
    )
    found = one(tmp_path, stacked)
    assert len({test.sample for test in found}) == 3
    for k, test in enumerate(found, 1):
        assert_right(test, 1 + 0.1 * k)


def test_specimens_with_their_columns_in_another_order(tmp_path):
    turned = "\n".join(",".join(line.split(",")[::-1]) for line in table(rows(1.2), quote="").splitlines())
    one_way, other_way = one(tmp_path, table(rows(), quote="") + "Specimen 2\n" + turned)
    assert_right(one_way)
    assert_right(other_way, 1.2)

    # A summary that names the columns is no specimen
    with pytest.raises(TableError, match="both name the columns"):
        one(tmp_path, "Report\nTime,Weg,Kraft\n\n" + table(rows(), quote=""))


SIDES = [
    {
        "files": ["d.csv"],
        "kind": kind,
        "strain": {"column": str(2 * k + 1), "measure": "stretch"},
        "stress": {"column": str(2 * k + 2), "unit": "MPa", "measure": "nominal"},
        "table": {"header": False, "skip_rows": 1, "columns": 6},
    }
    for k, kind in enumerate(KINDS)
]


def beside(lengths=(41, 41, 41)):
    cells = [
        [
            f"{LAM[i]:.5f},{0.05 * curve[i]:.6f}" if i < length else ","
            for curve, length in zip(KINDS.values(), lengths)
        ]
        for i in range(41)
    ]
    return "UT,,PS,,ET,\n" + "\n".join(",".join(line) for line in cells)


@pytest.mark.parametrize("lengths", [(41, 41, 41), (41, 20, 30), (10, 41, 12)])
def test_curves_side_by_side_are_all_read(tmp_path, lengths):
    found = {test.test: test for test in read_all(tmp_path, SIDES, d=beside(lengths))}
    for (kind, curve), length in zip(KINDS.items(), lengths):
        np.testing.assert_allclose(found[kind].nominal_stress, 0.05 * curve[:length], atol=1e-6)


def test_entries_read_the_files_that_they_name_and_two_curves_are_two_samples(tmp_path):
    # Two curves of one kind are two samples without holes
    entries = [
        {**SIDES[0], "files": ["d.csv"]},
        {**SIDES[1], "kind": "uniaxial", "plausible_shear_modulus_kPa": [20, 100]},
    ]
    assert len({test.sample for test in read_all(tmp_path, entries, d=beside())}) == 2

    # A hole in one curve is refused
    lines = beside().splitlines()
    cells = lines[20].split(",")
    lines[20] = ",".join([cells[0], "", *cells[2:]])
    with pytest.raises(TableError, match=r"d\.csv, row 21: 2 is nothing"):
        read_all(tmp_path, SIDES, d="\n".join(lines))

    # An entry reads the files that it names and are left
    named = tmp_path / "named"
    named.mkdir()
    entry = {"files": ["d.csv", "e.csv"], "kind": "uniaxial", **COLUMNS}
    with pytest.raises(
        TableError, match=r"entry 1 of the mapping \(uniaxial, files \['e\.csv'\]\) reads no file"
    ):
        read_all(named, [entry], d=table(rows()))
    assert len(read_all(named, [entry | {"optional": True}], d=table(rows()))) == 1
    mapping = {"describes": "made here", "ignore": ["*"], "tests": [entry]}
    (named / "mapping.yaml").write_text(yaml.safe_dump(mapping))
    with pytest.raises(TableError, match=r"none of its 2 files is read as a test; `ignore` is \['\*'\]"):
        read_sources([named], named / "mapping.yaml")

    # A later pattern that fits too reads only what is left
    entries = [*SIDES, {"files": ["*.csv"], "kind": "uniaxial", **COLUMNS}]
    found = read_all(named, entries, d=beside(), other=table(rows()))
    assert sorted(test.source for test in found) == ["d.csv"] * 3 + ["other.csv"]
    mapping = load_mapping(named / "mapping.yaml")
    assert len(mapping.entries_for("d.csv")) == 3 and mapping.entry_for("d.csv").kind == "uniaxial"


@pytest.mark.parametrize("pattern", ["zug_*.csv", "*"])
def test_an_entry_that_reads_no_file_is_an_error_unless_optional(tmp_path, pattern):
    entries = [*SIDES, {**SIDES[0], "files": [pattern]}]
    with pytest.raises(
        TableError, match=r"entry 4 of the mapping \(uniaxial, files .*\) reads no file; .*optional: true"
    ):
        read_all(tmp_path, entries, d=beside())
    entries[-1]["optional"] = True
    assert len(read_all(tmp_path, entries, d=beside())) == 3
