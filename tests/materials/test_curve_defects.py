"""Defects of a test curve are named by what they are, and following the remedy gives the right modulus; files made here."""

import numpy as np
import pytest
import yaml

from gelforge.config.foreign.mapping import load_mapping
from gelforge.csv_table import TableError
from gelforge.materials.basis.stresses import ogden_shape
from gelforge.materials.readers.mapped_files import read_mapped
from gelforge.materials.readers.material_tests import read_material_tests

G = 0.025  # MPa
LAM = np.linspace(1.0, 2.0, 201)
ENTRY = {
    "files": ["*.csv"],
    "kind": "uniaxial",
    "strain": {"column": "stretch", "measure": "stretch"},
    "stress": {"column": "P", "unit": "kPa", "measure": "nominal"},
}


def P(lam):
    return 1e3 * G * (lam - lam**-2)


def read(folder, lam, stress, time=None, corrections=None, **changes):
    columns = {"stretch": lam, "P": stress} | ({} if time is None else {"t": time})
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns.values())]
    (folder / "a.csv").write_text("\n".join([",".join(columns), *rows]) + "\n")
    entry = {**ENTRY, **changes} | ({} if time is None else {"time": {"column": "t"}})
    entry["corrections"] = corrections or {}
    (folder / "m.yaml").write_text(yaml.safe_dump({"describes": "made here", "tests": [entry]}))
    return read_mapped(folder / "a.csv", load_mapping(folder / "m.yaml").entry_for("a.csv"))[0]


def modulus(test):
    """Return the shear modulus [kPa] of a test that is neo-Hookean, by least squares."""
    shape = test.stretch - test.stretch**-2
    return 1e3 * float(shape @ test.nominal_stress / (shape @ shape))


def noisy(stress, seed=0, sd=0.1):
    return stress + sd * np.random.default_rng(seed).normal(size=len(stress))


@pytest.mark.parametrize("preload", [0.08, 0.12, 0.2])
def test_a_preload_is_refused_and_the_remedy_mends_it(tmp_path, preload):
    true = LAM * (1 + preload)
    with pytest.raises(TableError, match=r"largest stress, at stretch 1; 10% .* a preload.*`toe: remove`"):
        read(tmp_path, LAM, noisy(P(true)))
    mended = read(tmp_path, LAM, noisy(P(true)), corrections={"toe": "remove"})
    assert modulus(mended) == pytest.approx(1e3 * G, rel=0.02)


@pytest.mark.parametrize("exponent", [1.3, 2.0, 3.0])
@pytest.mark.parametrize(("kind", "end", "preload"), [("uniaxial", 1.8, 0.1), ("compression", 0.65, -0.04)])
def test_a_preload_of_a_way_over_the_unloaded_length_is_mended(tmp_path, kind, end, preload, exponent):
    """The extension was set to zero under load; the gauge length is that of the specimen before."""
    stretch = np.linspace(1 + preload, end, 161)
    stress = 1e3 * G * ogden_shape(kind, stretch, exponent)
    way = stretch - 1 - preload
    strain = {"column": "stretch", "measure": "engineering"}
    mended = read(
        tmp_path, way, noisy(stress, sd=0.01), kind=kind, strain=strain, corrections={"toe": "remove"}
    )
    shape = ogden_shape(kind, mended.stretch, exponent)
    assert 1e3 * float(shape @ mended.nominal_stress / (shape @ shape)) == pytest.approx(1e3 * G, rel=0.01)

    # An unloading back to the zero of the extension changes nothing
    (tmp_path / "a.csv").unlink()
    cycle = [np.concatenate([one, one[::-1]]) for one in (way, noisy(stress, sd=0.01))]
    known = {"history": "cyclic", "corrections": {"toe": "remove"}, "time": np.arange(322.0)}
    again = read(tmp_path, *cycle, kind=kind, strain=strain, **known)
    assert again.stretch[0] == pytest.approx(mended.stretch[0], abs=1e-3)


def test_a_pull_at_rest_is_an_offset_and_a_cut_must_leave_enough(tmp_path):
    # A pull that rest cannot have is an offset
    with pytest.raises(TableError, match="an offset of the force") as caught:
        read(tmp_path, LAM, noisy(P(LAM)) - 8)
    assert "preload" not in str(caught.value)
    assert modulus(read(tmp_path, LAM, noisy(P(LAM)) - 8, corrections={"zero_force": True})) == pytest.approx(
        25, rel=0.02
    )

    # An offset of a few per cent is reported only
    test = read(tmp_path, LAM, noisy(P(LAM)) + 3)
    assert any("at rest: a preload" in text and "zero_force" in text for text in test.findings)

    # A cut that leaves too little is refused
    few = np.linspace(1, 1.5, 10)
    stress = P(few)
    stress[3:] *= 0.01
    with pytest.raises(TableError, match=r"3 rows are left before it, 5 at least are needed"):
        read(tmp_path, few, stress, corrections={"after_fall": "cut"})
    stress = P(LAM)
    stress[5:] *= 0.01
    with pytest.raises(TableError, match=r"the stretch before it has a range of 0\.0\d+, 0\.05 at least"):
        own_format(tmp_path, stress, "cut_after_fall")
    stress = P(few)
    stress[6:] *= 0.01
    assert len(read(tmp_path, few, stress, corrections={"after_fall": "cut"}).stretch) == 6


@pytest.mark.parametrize(
    ("factor", "cause"),
    [(0.0, "the specimen broke"), (0.03, "the specimen broke"), (0.8, "slipped in its grip")],
)
@pytest.mark.parametrize("at", [130, 190])
@pytest.mark.parametrize("kind", ["uniaxial", "compression"])
def test_a_fall_of_the_stress_is_named_and_cut(tmp_path, factor, cause, at, kind):
    lam = LAM if kind == "uniaxial" else 1 - 0.4 * (LAM - 1)
    stress = noisy(P(lam), sd=0.05)
    stress[at:] = factor * stress[at:]
    with pytest.raises(
        TableError,
        match=rf"a\.csv, row {at + 1}: the stress falls .* by row {at + 2} .*{cause}.*after_fall: cut",
    ):
        read(tmp_path, lam, stress, kind=kind)
    cut = read(tmp_path, lam, stress, kind=kind, corrections={"after_fall": "cut"})
    assert len(cut.stretch) == at and any("cut there" in text for text in cut.findings)
    assert modulus(cut) == pytest.approx(1e3 * G, rel=0.02)
    if factor == 0.8:
        kept = read(tmp_path, lam, stress, kind=kind, corrections={"after_fall": "keep"})
        assert len(kept.stretch) == len(lam)


@pytest.mark.parametrize("seed", range(2))
def test_noise_softening_and_a_hold_are_no_fall(tmp_path, seed):
    assert len(read(tmp_path, LAM, noisy(P(LAM), seed, 1.0)).stretch) == len(LAM)
    yields = P(LAM) * np.exp(-np.maximum(LAM - 1.7, 0))  # softens slowly
    assert len(read(tmp_path, LAM, noisy(yields, seed)).stretch) == len(LAM)
    held = np.r_[LAM, np.full(50, LAM[-1])]
    relaxed = np.r_[P(LAM), P(LAM)[-1] * (0.6 + 0.4 * np.exp(-np.arange(50) / 20))]
    time = np.arange(len(held)) * 1.0
    read(tmp_path, held, noisy(relaxed, seed), time, history="relaxation")
    cycle = np.r_[LAM, LAM[::-1]]
    read(tmp_path, cycle, noisy(np.r_[P(LAM), (P(LAM) * (LAM - 1))[::-1]], seed), history="cyclic")


@pytest.mark.parametrize("at", [0.5, 0.8])
def test_a_saturated_load_cell_is_named(tmp_path, at):
    whole = noisy(P(LAM))
    with pytest.raises(
        TableError, match="to the last digit, its largest value, .* the load cell is saturated"
    ):
        read(tmp_path, LAM, np.minimum(whole, at * whole.max()))
    read(tmp_path, LAM, 4 * np.round(whole / 4))  # a coarse one has equal rows everywhere


@pytest.mark.parametrize("scale", [5.0, 7.0, 10.0])
@pytest.mark.parametrize("digits", [0, 1])
def test_a_curve_that_flattens_by_itself_is_not_saturated(tmp_path, scale, digits):
    """A channel that rounds gives the plateau one value; the same channel that saturates below it is named."""
    flattens = np.round(40 * np.tanh(scale * (LAM - 1)), digits)
    top = flattens.max()
    assert (flattens == top).sum() > 20
    assert len(read(tmp_path, LAM, flattens).stretch) == len(LAM)
    with pytest.raises(TableError, match="the load cell is saturated"):
        read(tmp_path, LAM, np.minimum(np.round(P(LAM), 1 + digits), np.round(0.6 * P(LAM).max(), 1)))


@pytest.mark.parametrize("peak", [1.8, 1.93, 2.0])
@pytest.mark.parametrize("steps", [40, 160])
def test_a_maximum_in_a_channel_that_rounds_is_not_saturated(tmp_path, peak, steps):
    size = 40 * np.sin(np.pi / 2 * (LAM - 1) / (peak - 1))
    assert len(read(tmp_path, LAM, np.round(size * steps / 40) * 40 / steps).stretch) == len(LAM)


@pytest.mark.parametrize("seed", range(3))
def test_one_step_of_a_coarse_channel_is_no_slip_and_no_odd_row(tmp_path, seed):
    size = noisy(40 * (1 - np.exp(-4 * (LAM - 1))), seed, 0.8)
    assert len(read(tmp_path, LAM, 2.5 * np.round(size / 2.5)).stretch) == len(LAM)


@pytest.mark.parametrize("history", ["monotonic", "cyclic"])
@pytest.mark.parametrize("count", [12, 25, 60])
@pytest.mark.parametrize("seed", range(3))
def test_points_in_any_order_are_named_and_sorted(tmp_path, history, count, seed):
    lam = np.random.default_rng([seed, count]).permutation(np.linspace(1, 2, count))
    with pytest.raises(
        TableError,
        match=r"rows are in no order of the stretch, .*unsorted: sort|points are in no order, sort",
    ):
        read(tmp_path, lam, P(lam), history=history)
    ordered = read(tmp_path, lam, P(lam), history=history, corrections={"unsorted": "sort"})
    np.testing.assert_allclose(ordered.stretch, np.linspace(1, 2, count))
    assert modulus(ordered) == pytest.approx(1e3 * G, rel=1e-3)


def test_the_order_of_points_is_checked_and_the_own_format_has_the_same_remedies(tmp_path):
    # The order of points is checked
    lam = np.linspace(1, 2, 30)
    lam[[10, 14]] = lam[[14, 10]]
    with pytest.raises(TableError, match="where the points are in no order, sort them with .*unsorted: sort"):
        read(tmp_path, lam, P(lam))

    # Coarse cycles are no disorder
    way = np.linspace(1, 2, 6)
    cycles = np.tile(np.r_[way, way[::-1][1:-1]], 4)
    assert len(read(tmp_path, cycles, P(cycles), history="cyclic").segments) >= 7

    # A test that only unloads is refused
    with pytest.raises(TableError, match="no loading is found"):
        read(tmp_path, LAM[::-1], P(LAM)[::-1], history="cyclic")

    # The own format has the same remedies
    broken = P(LAM)
    broken[150:] = 0.01
    with pytest.raises(TableError, match="row 151: .* the specimen broke; .*`cut_after_fall`"):
        own_format(tmp_path, broken)
    assert len(own_format(tmp_path, broken, "cut_after_fall").stretch) == 150
    with pytest.raises(TableError, match="a preload"):
        own_format(tmp_path, P(1.1 * LAM))
    assert modulus(own_format(tmp_path, P(1.1 * LAM), "toe")) == pytest.approx(25, rel=0.02)


@pytest.mark.parametrize(
    ("header", "unit", "said"),
    [
        ("Load (N)", "kPa", "says N, the mapping declares kPa"),
        ("Stress [MPa]", "kPa", "says MPa, the mapping declares kPa; check the units: set `unit: MPa`"),
        ("stress_Pa", "kPa", "says Pa"),
        ("Spannung / MPa", "kPa", "says MPa"),
        ("stress in Pa", "kPa", "says Pa"),
        ("pull in fast", "kPa", None),
        ("Load (kPa)", "kPa", None),
        ("stress_kPa", "kPa", None),
        ("Channel (1)", "kPa", None),
        ("load_N", "kPa", None),  # no brackets, another quantity: N may be a name
        ("Spannung {N/mm2}", "MPa", None),
    ],
)
def test_a_header_that_contradicts_the_mapping_is_refused(tmp_path, header, unit, said):
    factor = 1e-3 if unit == "MPa" else 1.0
    lines = [f"stretch,{header}", *(f"{a:.6f},{factor * b:.9f}" for a, b in zip(LAM, P(LAM)))]
    (tmp_path / "a.csv").write_text("\n".join(lines))
    entry = {**ENTRY, "stress": {"column": header, "unit": unit, "measure": "nominal"}}
    (tmp_path / "m.yaml").write_text(yaml.safe_dump({"describes": "made here", "tests": [entry]}))
    entry = load_mapping(tmp_path / "m.yaml").entry_for("a.csv")
    if said:
        with pytest.raises(TableError, match=said):
            read_mapped(tmp_path / "a.csv", entry)
    else:
        assert modulus(read_mapped(tmp_path / "a.csv", entry)[0]) == pytest.approx(25, rel=1e-3)


def own_format(folder, stress, corrections=""):
    rows = [f"{a:.6f},{b:.6f}" for a, b in zip(LAM, stress)]
    (folder / "one.csv").write_text("\n".join(["stretch_1,nominal_stress_kPa", *rows]) + "\n")
    (folder / "samples.csv").write_text(f"file,test,sample,corrections\none.csv,uniaxial,s1,{corrections}\n")
    return read_material_tests(folder)[0]


@pytest.mark.parametrize("rows", [30, 40, 50])
def test_a_yield_point_of_a_curve_of_few_rows_that_bears_more_later_is_no_fall(tmp_path, rows):
    """The stress drops by 18 % over 7 % of strain, and grows beyond it, as of foams."""
    strain = np.linspace(0, 0.8, rows)
    yielded = np.where(strain < 0.2, strain / 0.2, 1 - 0.18 * np.clip((strain - 0.2) / 0.07, 0, 1))
    stress = 20 * (yielded + 1.2 * np.clip(strain - 0.3, 0, None))
    assert len(read(tmp_path, 1 + strain, stress).stretch) == rows
