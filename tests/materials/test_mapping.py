"""Mappings: what they read, what they refuse, and that nothing is changed unasked; on files made here."""

import numpy as np
import pytest
import yaml
from shared_data import MAPPINGS

from gelforge.config import ConfigError, Fitting
from gelforge.config.foreign.mapping import load_mapping
from gelforge.csv_table import TableError
from gelforge.materials.characterise import characterise_source
from gelforge.materials.fits import measured_effects
from gelforge.materials.readers.mapped_files import read_mapped, read_mapped_folder, read_microindentation
from gelforge.materials.readers.material_source import read_sources

G = 0.05  # MPa
LAM = np.linspace(1.0, 1.8, 41)
ENTRY = {
    "files": ["*.csv"],
    "kind": "uniaxial",
    "strain": {"column": "stretch", "measure": "stretch"},
    "stress": {"column": "P", "unit": "MPa", "measure": "nominal"},
    "plausible_shear_modulus_kPa": [20, 200],
}


def P(lam):
    return G * (lam - lam**-2)


@pytest.fixture
def read(tmp_path):
    """Return a function that writes a table (columns by name) and reads it by an entry with changes."""

    def run(columns, sep=",", decimal=".", name="a.csv", above="", encoding="utf-8", **changes):
        rows = zip(
            *[np.broadcast_to(v, np.shape(LAM) if np.ndim(v) == 0 else np.shape(v)) for v in columns.values()]
        )
        lines = [sep.join(columns)] + [
            sep.join(f"{v:.9g}".replace(".", decimal) if not isinstance(v, str) else v for v in row)
            for row in rows
        ]
        (tmp_path / name).write_bytes((above + "\n".join(lines) + "\n").encode(encoding))
        entry = {key: value for key, value in {**ENTRY, **changes}.items() if value is not None}
        text = yaml.safe_dump({"describes": "made here", "tests": [entry]})
        (tmp_path / "mapping.yaml").write_text(text)
        entry = load_mapping(tmp_path / "mapping.yaml").entry_for(name)
        return read_mapped(tmp_path / name, entry)

    return run


PLAIN = {"stretch": LAM, "P": P(LAM)}


@pytest.mark.parametrize("path", MAPPINGS, ids=lambda p: p.stem)
def test_every_mapping_of_the_project_is_valid(path):
    assert load_mapping(path).describes


@pytest.mark.parametrize(
    ("strain", "values", "more"),
    [
        ({"measure": "stretch"}, LAM, {}),
        ({"measure": "engineering"}, LAM - 1, {}),
        ({"measure": "engineering", "unit": "%"}, 100 * (LAM - 1), {}),
        ({"measure": "true"}, np.log(LAM), {}),
        ({"measure": "displacement", "unit": "mm"}, 40 * (LAM - 1), {"gauge_length_mm": 40}),
        ({"measure": "gap", "unit": "um"}, 2000 * LAM, {}),
    ],
    ids=["stretch", "engineering", "percent", "true", "displacement", "gap"],
)
@pytest.mark.parametrize(
    ("stress", "factor", "kind"),
    [
        ({"measure": "nominal", "unit": "kPa"}, lambda lam: 1e3, {}),
        ({"measure": "nominal", "unit": "Pa", "sign": -1}, lambda lam: -1e6, {}),
        ({"measure": "cauchy", "unit": "MPa"}, lambda lam: lam, {}),
        ({"measure": "force", "unit": "mN"}, lambda lam: 5e3, {"cross_section_mm2": 5}),
    ],
    ids=["kPa", "negative Pa", "cauchy", "force"],
)
def test_every_measure_gives_the_same_curve(read, strain, values, more, stress, factor, kind):
    table = {"e": values, "s": P(LAM) * factor(LAM)}
    test = read(table, strain={"column": "e", **strain}, stress={"column": "s", **stress}, **more, **kind)[0]
    np.testing.assert_allclose(test.stretch, LAM, rtol=1e-8)  # nine digits in the file
    np.testing.assert_allclose(test.nominal_stress, P(LAM), rtol=1e-7, atol=1e-10)


def test_inflation_needs_a_thin_membrane_and_other_separators_are_read(read):
    # Inflation and its thin membrane condition
    lam = LAM[1:]
    pressure = 2 * 0.5 * lam**-2 * G * (lam**2 - lam**-4) / 30 * 1e3
    table = {"p": pressure, "r": np.full(len(lam), 30.0), "stretch": lam}
    more = {
        "kind": "equibiaxial",
        "stress": {"column": "p", "unit": "kPa", "measure": "inflation"},
        "radius": {"column": "r", "unit": "mm"},
    }
    test = read(table, **more, thickness_mm=0.5)[0]
    np.testing.assert_allclose(test.nominal_stress, G * (lam - lam**-5), rtol=1e-6)
    with pytest.raises(TableError, match=r"row 2: radius 30 mm with a thickness of 4 mm.*needs r >= 10 h0"):
        read(table, **more, thickness_mm=4)

    # Semicolons decimal commas latin 1 and lines above
    form = {"separator": ";", "decimal": ",", "encoding": "latin-1", "skip_rows": 2}
    test = read(PLAIN, ";", ",", above="Gerät;1\n20 °C;;\n", encoding="latin-1", table=form)[0]
    np.testing.assert_allclose(test.stretch, LAM, rtol=1e-8)


def test_samples_are_split_kelvin_converted_and_values_read_from_the_name(read):
    # Samples that share a file are split and kelvin is converted
    table = {"id": ["a"] * 41 + ["b"] * 41, "stretch": np.r_[LAM, LAM], "P": np.r_[P(LAM), 2 * P(LAM)]}
    table["T"] = np.full(82, 293.15)
    a, b = read(table, split="id", temperature={"column": "T", "unit": "K"})
    assert (a.sample, b.sample) == ("a", "b")
    np.testing.assert_allclose(b.nominal_stress, 2 * a.nominal_stress, rtol=1e-7, atol=1e-12)
    assert a.temperature_C == pytest.approx(20.0)

    # A value in the name is read only where declared
    assert read(PLAIN, name="x_0d05.csv")[0].rate_per_s is None
    named = {"pattern": r"(?P<sample>x)_(?P<rate_per_s>[0-9d]+)", "decimal": "d"}
    test = read(PLAIN, name="x_0d05.csv", from_name=named)[0]
    assert test.rate_per_s == 0.05 and test.sample == "x"
    timed = {**PLAIN, "t": (LAM - 1) / 0.2}
    test = read(timed, name="x_0d05.csv", from_name=named, time={"column": "t"})[0]
    assert test.rate_per_s == pytest.approx(0.2)
    assert any("0.05 1/s is in the file's name, but the columns give 0.2" in s for s in test.findings)


TOE = np.r_[np.linspace(1, 1.03, 8), LAM[2:]]


def with_toe():
    """Return a curve whose sample was slack up to 1.03."""
    return {"stretch": TOE, "P": P(np.maximum(TOE / 1.03, 1.0))}


def test_corrections_are_made_only_when_asked_and_findings_say_what_is_missing(read):
    # Toe offset and late start are reported and corrected only when asked
    kept = read(with_toe())[0]
    assert any("extrapolates to zero at a strain of 0.0" in s for s in kept.findings), kept.findings
    np.testing.assert_allclose(kept.stretch, TOE, rtol=1e-8)
    moved = read(with_toe(), corrections={"toe": "remove"})[0]
    np.testing.assert_allclose(moved.stretch, TOE / 1.03, rtol=2e-3)  # a straight line through a slight curve
    offset = {"stretch": np.r_[np.ones(5), LAM], "P": np.r_[np.zeros(5), P(LAM)] + 0.002}
    assert any("2 kPa" in s and "at rest" in s for s in read(offset)[0].findings)
    assert read(offset)[0].nominal_stress[0] == pytest.approx(0.002)
    assert read(offset, corrections={"zero_force": True})[0].nominal_stress[0] == pytest.approx(0, abs=1e-9)
    late = {"stretch": LAM + 0.04, "P": P(LAM)}
    assert any("first row is at 1.04" in s for s in read(late)[0].findings)
    assert read(late, corrections={"zero_strain": True})[0].stretch[0] == pytest.approx(1.0)

    # A curve reports what is missing or unchecked
    assert read(PLAIN)[0].findings == ("no time column: rate, holds and relaxation cannot be found",)
    assert read({**PLAIN, "t": LAM}, time={"column": "t"})[0].findings == ()

    # A range too wide to show a unit wrong by a thousand is said
    wide = {"plausible_shear_modulus_kPa": [0.5, 5000]}
    soft = read({"stretch": LAM, "P": 0.04 * P(LAM)}, **wide)[0]  # 2 kPa; as kPa for Pa it would be 2000
    assert any(s.startswith("units are not checked: a shear modulus of 2 kPa") for s in soft.findings)
    assert not any(
        "units are not checked" in s for s in read(PLAIN, **wide)[0].findings
    )  # 50 kPa: both fall out
    assert not any("units are not checked" in s for s in read(PLAIN)[0].findings)


def test_time_that_goes_back_or_stands_still(read):
    t = np.arange(41.0)
    t[20] = 5.0
    column = {"time": {"column": "t"}}
    with pytest.raises(TableError, match=r"row 22: t 5 s after 19 s.*set_aside"):
        read({**PLAIN, "t": t}, **column)
    test = read({**PLAIN, "t": t}, **column, corrections={"time": "set_aside"})[0]
    assert test.time_s is None and any("time set aside" in s for s in test.findings)
    still = np.floor(np.arange(41) / 4)
    assert any("30 of 41 rows repeat" in s for s in read({**PLAIN, "t": still}, **column)[0].findings)
    once = read({**PLAIN, "t": still}, **column, corrections={"repeated_time": "average"})[0]
    assert len(once.stretch) == 11 and once.stretch[0] == pytest.approx(LAM[:4].mean())


CYCLE = np.r_[LAM, LAM[-2::-1]]
PER_CENT = {"column": "stretch", "measure": "engineering", "unit": "%"}
BAD = {
    "column dropped": ({"stretch": LAM}, {}, r"columns \['P'\] are missing"),
    "wrong unit": ({"stretch": LAM, "P": 1e3 * P(LAM)}, {}, r"shear modulus of 5e\+04 kPa; 20 to 200 kPa"),
    "swapped": ({"stretch": P(LAM), "P": LAM}, {}, r"gives a stretch of 0;.*check the column"),
    "wrong sign": ({"stretch": LAM, "P": -P(LAM)}, {}, r"set `sign: -1`"),
    "cycle": ({"stretch": CYCLE, "P": P(CYCLE)}, {}, r"row 43: a: stretch 1.78 after 1.8; a monotonic test is declared"),
    "per cent as number": ({"stretch": LAM - 1, "P": P(LAM)}, {"strain": PER_CENT}, r"reaches a strain of 0.008"),
    "rate declared": ({**PLAIN, "t": LAM}, {"time": {"column": "t"}, "rate_per_s": 0.01}, r"declares 0.01 1/s.*unit of t"),
    "text": ({"stretch": LAM, "P": ["x"] * 41}, {}, r"row 2: P is 'x'; a finite number is needed"),
    "other measure": ({**PLAIN, "e": LAM - 1}, {"also": [{"column": "e", "measure": "true"}]}, r"describe the same test"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_what_cannot_be_right_is_refused(read, what):
    columns, changes, message = BAD[what]
    with pytest.raises(TableError, match=message):
        read(columns, **changes)


def test_empty_files_decimal_commas_and_few_rows(read, tmp_path):
    read(PLAIN)
    entry = load_mapping(tmp_path / "mapping.yaml").entry_for("a.csv")
    (tmp_path / "a.csv").write_text("")
    with pytest.raises(TableError, match="no header line"):
        read_mapped(tmp_path / "a.csv", entry)
    with pytest.raises(TableError, match=r"is '1,02'; a finite number is needed \(decimal sign .\)"):
        read(PLAIN, ";", ",", table={"separator": ";"})
    with pytest.raises(TableError, match=r"decimal commas need semicolons"):
        read(PLAIN, ",", ",")

    # Ten rows are read and said to be few
    test = read({"stretch": LAM[::4][:10], "P": P(LAM[::4][:10])})[0]
    assert test.findings[0].startswith("only 10 rows")
    with pytest.raises(TableError, match="4 rows; 5 at least"):
        read({"stretch": LAM[:4], "P": P(LAM[:4])})


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"stress": {"column": "P", "unit": "ksi", "measure": "nominal"}}, "unit 'ksi' is not known"),
        ({"stress": {"column": "P", "unit": "mm", "measure": "nominal"}}, "unit 'mm' is no pressure"),
        ({"stress": None}, "kind uniaxial needs `stress`"),
        ({"stress": {"column": "P", "unit": "N", "measure": "force"}}, "needs cross_section_mm2"),
        ({"kind": "simple_shear"}, "shear goes with shear"),
        ({"strain": {"column": "e", "unit": "mm", "measure": "displacement"}}, "needs gauge_length_mm"),
        ({"from_name": {"pattern": "(?P<colour>.)"}}, "groups may be"),
        ({"unknown": 1}, "unknown key"),
    ],
)
def test_a_mapping_that_cannot_be_used_says_why(read, changes, message):
    with pytest.raises(ConfigError, match=message):
        read(PLAIN, **changes)


def test_a_folder_names_the_file_that_is_no_test(read, tmp_path):
    read(PLAIN)
    mapping = load_mapping(tmp_path / "mapping.yaml")
    with pytest.raises(ConfigError, match=r"mapping.yaml: no entry of the mapping fits"):
        read_mapped_folder(tmp_path, mapping)

    # An empty folder in the place of a test is refused
    read(PLAIN)
    mapping = load_mapping(tmp_path / "mapping.yaml").model_copy(update={"ignore": ["*.yaml"]})
    (tmp_path / "of_may.2026").mkdir()  # no name of a test
    (tmp_path / "b.csv").mkdir()
    with pytest.raises(
        TableError, match=r"b\.csv: an empty folder where a file of a test is expected; put the file"
    ):
        read_mapped_folder(tmp_path, mapping)
    (tmp_path / "a.csv").rename(tmp_path / "b.csv" / "a.csv")  # as some programs unpack: the file is inside
    assert [test.source for test in read_mapped_folder(tmp_path, mapping)] == ["b.csv/a.csv"]


def test_own_microindentation_with_its_sidecar(tmp_path):
    depth = np.linspace(-0.1, 0.2, 60)
    force = 16 / 9 * 2.0 * np.sqrt(3.0) * np.maximum(depth, 0) ** 1.5
    rows = "\n".join(f"{d:.6f},{f:.8f}" for d, f in zip(depth, force))
    (tmp_path / "press.csv").write_text("depth_mm,force_N\n" + rows)
    (tmp_path / "press.yaml").write_text("ball_radius_mm: 3\nlayer_thickness_mm: 4\n")
    test, sidecar = read_microindentation(tmp_path / "press.csv")
    assert test.ball_radius_mm == 3 and sidecar.layer_thickness_mm == 4 and len(test.force_N) == 60


BALL = {
    "kind": "indentation",
    "strain": None,
    "stress": None,
    "height": {"column": "z", "unit": "mm"},
    "force": {"column": "F", "unit": "N"},
    "ball_radius_mm": 2,
}


def pressed(give=0.0):
    """Return a press of a ball of 2 mm into a half space of 3 MPa on a machine that gives `give` mm per N."""
    d = np.linspace(-0.1, 0.3, 160)
    force = 16 / 9 * 3 * np.sqrt(2) * np.maximum(d, 0) ** 1.5
    return {"z": d + give * force, "F": force}


def test_layer_and_rigid_board_are_declared_in_a_mapping(read, tmp_path):
    z = np.linspace(-0.1, 0.1, 120)
    board = {"z": z, "F": np.maximum(z, 0) / 0.05}
    declared = {**BALL, "rigid_board": "board.csv", "plausible_stiffness_N_per_m": [100, 50000]}
    read(board, name="board.csv", **declared)
    read(pressed(0.05), name="soft.csv", **declared)
    mapping = (tmp_path / "mapping.yaml").rename(tmp_path.with_suffix(".yaml"))
    [both] = map(
        measured_effects, read_sources([tmp_path], mapping)
    )  # no material is named: both files are of the folder's
    [modulus] = both.effects
    assert modulus.samples == ("soft",) and modulus.value == pytest.approx(
        3.0, rel=0.02
    )  # touch of the board: a row
    assert dict(both.not_judged)["microindentation"] == "board.csv is the test on the rigid board itself"
    [alone] = read_sources([tmp_path / "soft.csv"], mapping)
    assert measured_effects(alone).effects[0].value == pytest.approx(modulus.value, rel=1e-9)
    assert {p.name for p in alone.files} == {"soft.csv", "board.csv", mapping.name}
    (tmp_path / "board.csv").unlink()
    with pytest.raises(TableError, match=r"soft\.csv: rigid_board 'board\.csv' is not there"):
        read_sources([tmp_path / "soft.csv"], mapping)
    thin = read(pressed(), name="thin.csv", **BALL, layer_thickness_mm=1.5)[0]
    assert thin.layer_thickness_mm == 1.5
    [layer] = read_sources([tmp_path / "thin.csv"], tmp_path / "mapping.yaml")
    [effect] = measured_effects(layer).effects
    assert effect.value < 0.7 * 3.0  # a thin layer needs less modulus for the same force
    assert "the layer's thickness raises the force by" in effect.sentence


def test_a_press_is_checked_and_what_is_odd_is_in_the_notes(read, tmp_path):
    table = pressed()
    with pytest.raises(TableError, match=r"travels 400 mm with a ball of 2 mm radius; 50 radii at most"):
        read({**table, "z": 1e3 * table["z"]}, **BALL)

    # What is odd about a press is in the notes
    read(pressed(), name="soft.csv", **BALL)
    [material] = read_sources([tmp_path / "soft.csv"], tmp_path / "mapping.yaml")
    result = characterise_source(material, Fitting(), tmp_path / "out", law_needed=False)
    notes = (tmp_path / "out" / "notes.txt").read_text()
    assert "soft: the contact point is not in the file" in notes and "no time column" in result.summary
