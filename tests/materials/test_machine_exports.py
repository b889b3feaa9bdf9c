"""Exports of testing machines: units rows, preambles, trailing separators, filters, units, and equal file names."""

import numpy as np
import pytest
import yaml

from gelforge.config import ConfigError
from gelforge.config.foreign.mapping import load_mapping
from gelforge.csv_table import TableError
from gelforge.materials.fitting.curves import mean_curves
from gelforge.materials.fitting.sample_scatter import scatter
from gelforge.materials.readers.mapped_files import read_mapped, read_mapped_folder
from gelforge.materials.readers.material_source import read_sources
from gelforge.materials.small_tests.microindentation import fit_modulus
from gelforge.materials.small_tests.small_effects import small_effects
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.units import UNITS, unit_named

G = 0.05  # MPa
LAM = np.linspace(1.0, 1.8, 41)
FORCE = 10 * G * (LAM - LAM**-2)  # N, on 10 mm2
ENTRY = {
    "files": ["*.csv"],
    "kind": "uniaxial",
    "strain": {"column": "way", "unit": "mm", "measure": "displacement"},
    "stress": {"column": "load", "unit": "N", "measure": "force"},
    "gauge_length_mm": 40,
    "cross_section_mm2": 10,
    "plausible_shear_modulus_kPa": [20, 200],
}


def rows(factor_way=1.0, factor_load=1.0, end="", force=FORCE):
    return [
        f"{40 * (a - 1) / factor_way:.9g},{b / factor_load:.9g},{i % 2}{end}"
        for i, (a, b) in enumerate(zip(LAM, force))
    ]


def write(folder, lines, name="a.csv", **changes):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    entry = {**ENTRY, **changes}
    (folder / "mapping.yaml").write_text(
        yaml.safe_dump({"describes": "made here", "ignore": ["*.yaml"], "tests": [entry]})
    )
    return path


def read(folder, lines, **changes):
    path = write(folder, lines, **changes)
    return read_mapped(path, load_mapping(folder / "mapping.yaml").entry_for(path.name))[0]


def assert_right(test):
    np.testing.assert_allclose(test.stretch, LAM, rtol=1e-7)
    np.testing.assert_allclose(test.nominal_stress, FORCE / 10, rtol=1e-7, atol=1e-9)


HEADER = "way,load,part"


@pytest.mark.parametrize(
    "units", ["(mm),(N),", "[mm],[N],[-]", "mm,N,1/s", '"(mm)","(N)","(#)"'], ids=lambda text: text
)
def test_a_line_of_units_is_recognised(tmp_path, units):
    assert_right(read(tmp_path, [HEADER, units, *rows()]))


FACTORS = {"in": 25.4, "cm": 10.0, "um": 1e-3, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605}


@pytest.mark.parametrize("unit", FACTORS)
def test_units_of_length_and_force(tmp_path, unit):
    of_way = UNITS[unit][0] == "length"
    way, load = (FACTORS[unit], 1) if of_way else (1, FACTORS[unit])
    key = (
        {"strain": ENTRY["strain"] | {"unit": unit}}
        if of_way
        else {"stress": ENTRY["stress"] | {"unit": unit}}
    )
    assert_right(read(tmp_path, [HEADER, *rows(way, load)], **key))


# NIST SP 811, appendix B: 1 psi = 6.894757 kPa, 1 kgf/cm2 = 98.0665 kPa, 1 bar = 100 kPa
@pytest.mark.parametrize(
    ("unit", "MPa"),
    [("psi", 6.894757e-3), ("kgf/cm2", 0.0980665), ("bar", 0.1), ("N/mm2", 1.0), ("kPa", 1e-3)],
)
def test_units_of_stress_and_percent(tmp_path, unit, MPa):
    lines = ["e,s", *(f"{100 * (a - 1):.9g},{f / 10 / MPa:.9g}" for a, f in zip(LAM, FORCE))]
    strain = {"column": "e", "unit": "percent", "measure": "engineering"}
    test = read(tmp_path, lines, strain=strain, stress={"column": "s", "unit": unit, "measure": "nominal"})
    np.testing.assert_allclose(test.stretch, LAM, rtol=1e-7)
    np.testing.assert_allclose(test.nominal_stress, FORCE / 10, rtol=1e-6, atol=1e-9)


def test_units_are_known_by_their_spellings_and_a_line_of_others_is_refused(tmp_path):
    # Spellings of a unit
    found = [unit_named(t) for t in ("(µm)", "μm", "[kgf/cm²]", "N/mm^2", "sec", "degF", "mN", "MN", "")]
    assert found == ["um", "um", "kgf/cm2", "MPa", "s", "degF", "mN", None, None]

    # A line of other units or of text is refused unless declared
    with pytest.raises(TableError, match=r"row 2: load is in \(kN\), the mapping declares N; set `unit: kN`"):
        read(tmp_path, [HEADER, "(mm),(kN),", *rows(1, 1e3)])

    # Text that is no unit is not skipped unless declared
    lines = [HEADER, "way of head,newtons,", *rows()]
    with pytest.raises(TableError, match="row 2: way is 'way of head'"):
        read(tmp_path, lines)
    assert_right(read(tmp_path, lines, table={"units_row": True}))
    with pytest.raises(TableError, match="row 2: numbers, where `units_row: true`"):
        read(tmp_path, [HEADER, *rows()], table={"units_row": True})
    with pytest.raises(TableError, match=r"row 2: way is '\(mm\)'"):
        read(tmp_path, [HEADER, "(mm),(N),", *rows()], table={"units_row": False})


def test_a_header_below_lines_and_separators_at_their_end_are_read(tmp_path):
    # A header below lines of any number
    above = ["Machine 7", "", "Rate;10 mm/min", 'Remark "open', "way of the head"]
    for count in (0, 2, 5):
        lines = [*above[:count], HEADER, "", *rows()]
        assert_right(read(tmp_path, lines, table={"header_begins_with": "way,"}))
    assert_right(read(tmp_path, [*above, HEADER, *rows()]))  # the only line that names the columns
    assert_right(read(tmp_path, [*above, HEADER, *rows()], table={"skip_rows": 3}))
    with pytest.raises(TableError, match="no line begins with 'Time'"):
        read(tmp_path, [HEADER, *rows()], table={"header_begins_with": "Time"})
    with pytest.raises(TableError, match="rows 2 and 4: both name the columns"):
        read(tmp_path, ["Machine", HEADER, "", HEADER, *rows()])
    with pytest.raises(ConfigError, match="leave `skip_rows` and `header` out"):
        read(tmp_path, [HEADER, *rows()], table={"header_begins_with": "way", "skip_rows": 1})

    # Separators at the end of lines
    assert_right(read(tmp_path, [f"{HEADER},,", *rows(end=",,")]))
    assert_right(read(tmp_path, [HEADER, *rows(end=",")]))
    assert_right(read(tmp_path, [f"{HEADER},", *rows()]))
    with pytest.raises(TableError, match="row 2: 4 values for 3 columns"):
        read(tmp_path, [HEADER, *rows(end=",7")])


def test_rows_are_filtered_before_their_numbers_are_read(tmp_path):
    mixed = [HEADER, *[f"{line},a" if i % 3 else "x,y,z,b" for i, line in enumerate(rows())]]
    mixed[0] += ",kind"
    kept = read(tmp_path, mixed, rows=[{"column": "kind", "equals": ["a"]}])
    np.testing.assert_allclose(kept.stretch, np.delete(LAM, slice(None, None, 3)), rtol=1e-7)
    plain = [HEADER, *rows()]
    assert len(read(tmp_path, plain, rows=[{"column": "part", "equals": [1]}]).stretch) == 20
    assert len(read(tmp_path, plain, rows=[{"column": "way", "at_least": 8, "at_most": 24}]).stretch) == 21
    with pytest.raises(TableError, match="filter of rows by part keeps none of 41 rows"):
        read(tmp_path, plain, rows=[{"column": "part", "equals": [3]}])
    for other in ({"column": "way", "at_most": 8}, {"column": "part", "equals": [1.0]}):
        read(tmp_path, plain, rows=[other, {"column": "part", "equals": ["1"]}])
    with pytest.raises(TableError, match="names the column 'cycle'; found"):
        read(tmp_path, plain, rows=[{"column": "cycle", "equals": [3]}])
    with pytest.raises(ConfigError, match="needs `equals`, `at_least` or `at_most`"):
        read(tmp_path, plain, rows=[{"column": "part"}])


def test_a_value_of_a_filter_of_rows_stands_in_a_file_of_its_entry(tmp_path):
    def folder_with(*wanted):
        filters = [{"column": "way", "at_most": 20}, {"column": "part", "equals": list(wanted)}]
        write(tmp_path, [HEADER, *rows()], rows=filters)
        ones = [HEADER, *[line for line in rows() if line.endswith(",1")]]
        write(tmp_path, ones, name="b.csv", rows=filters)
        return read_mapped_folder(tmp_path, load_mapping(tmp_path / "mapping.yaml"))

    for wanted in ([1], [1.0], ["0", 1]):
        assert len(folder_with(*wanted)) == 2
    with pytest.raises(
        TableError, match=r"has \['3'\] in the column 'part'; found \['0', '1'\], correct `rows.equals`"
    ):
        folder_with(1, 3)


def batches(folder, factors):
    for name, factor in factors.items():
        write(folder, [HEADER, *rows(force=factor * FORCE)], name=name)
    return read_sources([folder], folder / "mapping.yaml")[0]


def test_samples_are_named_by_their_folders_and_named_once(tmp_path):
    # Equal file names in folders are samples of their own
    factors = {"10A/run_1.csv": 1.0, "10A/run_2.csv": 1.02, "20A/run_1.csv": 2.2, "20A/run_2.csv": 2.21}
    source = batches(tmp_path / "gel", factors)
    assert [t.sample for t in source.tests] == ["10A/run_1", "10A/run_2", "20A/run_1", "20A/run_2"]
    assert {p.relative_to(tmp_path / "gel").as_posix() for p in source.files} == {*factors, "mapping.yaml"}
    law = Ogden((G,), (2.0,))
    said = scatter(mean_curves(list(source.tests))[0], law)
    assert len(said) == 1 and "(10A/run_1)" in said[0] and "(20A/run_2), a factor of 2.21" in said[0]

    # Samples that scatter as moulds do are no finding
    moulds = tmp_path / "moulds"
    source = batches(moulds / "gel", {"a.csv": 0.98, "b.csv": 1.0, "c.csv": 1.03})
    assert [t.sample for t in source.tests] == ["a", "b", "c"]
    assert scatter(mean_curves(list(source.tests))[0], Ogden((G,), (2.0,))) == []

    # A file that is named twice is refused and two folders are not
    named = tmp_path / "named"
    for day, factor in (("day1", 1.0), ("day2", 1.01)):
        batches(named / day, {"run_1.csv": factor})
    mapping = named / "day1/mapping.yaml"
    entry = yaml.safe_load(mapping.read_text())
    entry["tests"][0]["material"] = "gel"
    mapping.write_text(yaml.safe_dump(entry))
    found = read_sources([named / "day1", named / "day2"], mapping)
    assert [t.sample for t in found[0].tests] == [
        f"{named.as_posix()}/{day}/run_1" for day in ("day1", "day2")
    ]
    with pytest.raises(TableError, match="sample .* is read twice; name each file or folder once"):
        read_sources([named / "day1", named / "day1"], mapping)


def press(tmp_path, contact_mm):
    """Write a press of a ball (R = 0.5 mm, E = 0.06 MPa) with hold and way back, and return it as read."""
    way = np.r_[
        np.linspace(0, 0.06, 200),
        0.06 + 0.0015 * (1 - np.exp(-np.arange(60) / 10)),
        np.linspace(0.0615, 0, 200),
    ]
    segment = np.r_[np.full(200, 1), np.full(60, 2), np.full(200, 3)]
    depth = np.maximum(np.minimum(way, 0.06) - contact_mm, 0)
    force = 16 / 9 * 0.06 * np.sqrt(0.5) * depth**1.5 * 1e6 + np.random.default_rng(1).normal(0, 2, len(way))
    lines = [
        "z,F,part,t",
        *(f"{a:.6f},{f:.4f},{s},{i}" for i, (a, f, s) in enumerate(zip(way, force, segment))),
    ]
    changes = {"strain": None, "stress": None, "gauge_length_mm": None, "cross_section_mm2": None}
    changes |= {
        "kind": "indentation",
        "height": {"column": "z", "unit": "mm"},
        "force": {"column": "F", "unit": "uN"},
    }
    changes |= {"segment": "part", "ball_radius_mm": 0.5, "time": {"column": "t"}}
    write(tmp_path / "gel", lines, name="p.csv", **changes)
    return read_sources([tmp_path / "gel"], tmp_path / "gel/mapping.yaml")[0].small


@pytest.mark.parametrize("contact", [0.0, 0.01])
def test_a_press_that_begins_at_touch_holds_and_withdraws(tmp_path, contact):
    found, _ = small_effects(press(tmp_path, contact))
    by_name = {e.effect: e for e in found}
    modulus, creep = by_name["microindentation"], by_name["relaxation"]
    assert modulus.value == pytest.approx(0.06, rel=0.02)
    assert modulus.parameters["contact_mm"] == pytest.approx(contact, abs=5e-4)
    assert ("begin at the touch" in modulus.sentence) == (contact == 0)
    assert creep.value == pytest.approx(0.0015, rel=0.02) and creep.parameters["hold_s"] == 59


def test_a_press_that_begins_deep_in_contact_is_still_refused(tmp_path):
    whole = press(tmp_path, 0.0).presses[0].test.in_segment("1")
    with pytest.raises(ValueError, match="no contact point"):
        fit_modulus(type(whole)("late", whole.position_mm[60:], whole.force_N[60:], ball_radius_mm=0.5))
