"""Raw material tests: the stress formulas by hand, and every bad input by its message."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gelforge.csv_table import TableError
from gelforge.materials.fitting.curves import monotonic_loading
from gelforge.materials.readers.material_tests import declared_synthetic, input_files, read_material_tests

HEADER = "file,test,sample,width_mm,thickness_mm"
STRETCHES = np.linspace(1.0, 2.0, 21)


def neo_hooke_force(lam, area_mm2, shear_modulus=0.02):
    return area_mm2 * shear_modulus * (lam - lam**-2)


def uniaxial(lam=STRETCHES, force=None, area_mm2=5.0):
    force = neo_hooke_force(lam, area_mm2) if force is None else force
    rows = [f"{10 * i},{f:.8g},{l:.8g}" for i, (f, l) in enumerate(zip(force, lam))]
    return "\n".join(["time_s,force_N,stretch_1", *rows]) + "\n"


def inflation(lam=STRETCHES[1:], radius=30.0, h0=0.5, shear_modulus=0.02):
    pressure = 2 * h0 * lam**-2 * shear_modulus * (lam**2 - lam**-4) / radius * 1e3
    rows = [f"{10 * i},{p:.8g},{radius},{l:.8g}" for i, (p, l) in enumerate(zip(pressure, lam))]
    return "\n".join(["time_s,pressure_kPa,apex_radius_mm,stretch_1", *rows]) + "\n"


@pytest.fixture
def material(tmp_path):
    """Return a function that writes files of a material's folder; without arguments all of them are good."""

    def write(samples=None, **files):
        default = f"{HEADER}\nua.csv,uniaxial,s1,10,0.5\neb.csv,equibiaxial,s1,,0.5\n"
        (tmp_path / "samples.csv").write_text(samples or default)
        for name, text in ({"ua": uniaxial(), "eb": inflation()} | files).items():
            (tmp_path / f"{name}.csv").write_text(text)
        return tmp_path

    return write


def test_cauchy_stress_of_each_kind_of_test(material):
    curve = read_material_tests(material())[0]
    assert (curve.test, curve.sample) == ("uniaxial", "s1")
    # 0.5 mm x 10 mm, stretch 2, F = 5 * 0.02 * (2 - 1/4) = 0.175 N: 0.175 * 2 / 5 = 0.07 MPa
    assert curve.cauchy_stress[-1] == pytest.approx(0.07, rel=1e-7)  # eight digits in the file
    assert curve.nominal_stress[-1] == pytest.approx(0.035, rel=1e-7)

    # Cauchy stress of a membrane is p r over twice the current thickness
    text = "time_s,pressure_kPa,apex_radius_mm,stretch_1,stretch_2\n0,0.3,60,1.2,1.25\n9,0.5,40,1.6,1.5\n"
    samples = f"{HEADER}\neb.csv,equibiaxial,s1,,0.5\n"
    curve = read_material_tests(material(samples, eb=text))[0]
    # lam_3 = 1 / (1.6 * 1.5) = 1/2.4; sigma = 0.5e-3 * 40 * 2.4 / (2 * 0.5) = 0.048 MPa
    assert_allclose(curve.cauchy_stress, [0.3e-3 * 60 * 1.5, 0.048], rtol=1e-12)

    # Without a tracked stretch 2 the membrane is equibiaxial
    curve = read_material_tests(material())[1]
    assert_allclose(curve.cauchy_stress, 0.02 * (curve.stretch**2 - curve.stretch**-4), rtol=1e-6)

    # A ready made curve needs no sample size
    samples = f"{HEADER}\nps.csv,pure_shear,s1,,\n"
    curve = read_material_tests(material(samples, ps="stretch_1,nominal_stress_kPa\n1,0\n1.5,24\n2,37.5\n"))[
        0
    ]
    assert_allclose(curve.cauchy_stress, [0, 0.036, 0.075])


def test_compression_and_tracking_noise_are_monotonic_and_a_gel_may_be_too_soft_to_check(material):
    # Compression and tracking noise are monotonic
    lam = np.linspace(1.0, 0.6, 20)
    curve = read_material_tests(material(ua=uniaxial(lam)))[0]
    assert curve.cauchy_stress[-1] < 0

    # Tracking noise is no reversal
    lam = STRETCHES.copy()
    lam[10] = lam[9] - 0.005  # half of the 1 % of the range that is let pass
    assert len(read_material_tests(material(ua=uniaxial(lam)))[0].stretch) == 21

    # A gel so soft that a unit wrong by a thousand stays plausible is said
    soft = uniaxial(force=neo_hooke_force(STRETCHES, 5.0, 0.002))  # 2 kPa, or 2 MPa with a force in mN
    found = read_material_tests(material(f"{HEADER}\nua.csv,uniaxial,s1,10,0.5\n", ua=soft))[0].findings
    assert any("units are not checked: a shear modulus of 2 kPa" in text for text in found)
    usual = read_material_tests(material())  # 20 kPa
    assert not any("units are not checked" in text for test in usual for text in test.findings)


def test_relaxation_samples_are_read_with_their_hold(material):
    samples = f"{HEADER}\nua.csv,uniaxial,s1,10,0.5\nrelax.csv,relaxation,s1,10,0.5\n"
    t = np.r_[np.linspace(0, 5, 20), 5 + np.geomspace(0.1, 200, 60)]
    lam = np.interp(t, [0, 5, 300], [1, 1.5, 1.5])
    rows = "".join(f"{a:.6g},{0.1 * (l - 1):.6g},{l:.6g}\n" for a, l in zip(t, lam))
    folder = material(samples, relax="time_s,force_N,stretch_1\n" + rows)
    tests = read_material_tests(folder)
    assert [(c.test, c.history) for c in tests] == [("uniaxial", "monotonic"), ("uniaxial", "relaxation")]
    assert [s.kind for s in tests[1].segments] == ["load", "hold"]
    assert monotonic_loading(tests)[0] == tests[:1]  # not fitted where there is another loading
    assert [path.name for path in input_files(folder)] == ["samples.csv", "ua.csv", "relax.csv"]


def with_row(text, number, row):
    lines = text.splitlines()
    lines[number - 1] = row
    return "\n".join(lines) + "\n"


def cycle():
    return uniaxial(np.concatenate([STRETCHES, STRETCHES[-2::-1]]))


UA = f"{HEADER}\nua.csv,uniaxial,s1,10,0.5\n"
BAD = {
    "missing column": (
        None,
        {"ua": "time_s,force_N\n0,1\n"},
        r"ua\.csv, row 1: columns \['stretch_1'\] are missing",
    ),
    "NaN": (None, {"ua": with_row(uniaxial(), 5, "30,nan,1.15")}, r"ua\.csv, row 5: force_N is 'nan'"),
    "not monotonic": (
        None,
        {"ua": with_row(uniaxial(), 15, "130,0.1,0.94")},
        r"ua\.csv, row 15: stretch_1 0\.94 after 1\.6; a monotonic test is expected, keep one loading",
    ),
    "cycle": (None, {"ua": cycle()}, r"ua\.csv, row 23: stretch_1 1\.95 after 2; a monotonic test"),
    "strain from 0": (
        None,
        {"ua": with_row(uniaxial(), 2, "0,0,0")},
        r"ua\.csv, row 2: stretch_1 is 0; .*write 1 \+ strain",
    ),
    "strain": (
        None,
        {"ua": uniaxial(np.linspace(0.02, 1, 20))},
        r"row 2: stretch_1 is 0\.02; between 0\.2 and 15",
    ),
    "per cent": (None, {"ua": uniaxial(100 * STRETCHES)}, r"row 2: stretch_1 is 100; between .* or per cent"),
    "short": (None, {"ua": uniaxial(np.linspace(1, 1.03, 9))}, r"from 1 to 1\.03; a range of 0\.05 at least"),
    "time": (None, {"ua": with_row(uniaxial(), 7, "1,0.05,1.25")}, r"row 7: time_s 1 after 40; sort"),
    "force in mN": (
        UA,
        {"ua": uniaxial(force=1e3 * neo_hooke_force(STRETCHES, 5.0))},
        r"ua\.csv: .*shear modulus of 2e\+04 kPa; a soft elastomer has 0\.5 to 5000 kPa, check the units",
    ),
    "force in kN": (
        UA,
        {"ua": uniaxial(force=1e-3 * neo_hooke_force(STRETCHES, 5.0))},
        r"shear modulus of 0\.02 kPa; a soft elastomer",
    ),
    "one sample in other units": (
        f"{HEADER}\n" + "".join(f"{n}.csv,uniaxial,{n},10,0.5\n" for n in ("a", "b", "c")),
        {"a": uniaxial(), "b": uniaxial(force=0.04 * neo_hooke_force(STRETCHES, 5.0)), "c": uniaxial()},
        r"b\.csv: .*modulus of 0\.8 kPa, the median of the samples 20 kPa; within a factor of 10",
    ),
    "pressure in Pa": (
        None,
        {"eb": inflation(shear_modulus=20.0)},
        r"eb\.csv: .*shear modulus of 2e\+04 kPa; a soft elastomer",
    ),
    "radius in m": (
        None,
        {"eb": inflation(radius=0.03)},
        r"eb\.csv, row 2: apex_radius_mm 0\.03 .*thin membrane",
    ),
    "thick membrane": (
        f"{HEADER}\neb.csv,equibiaxial,s1,,4\n",
        {},
        r"eb\.csv, row 2: apex_radius_mm 30 with a thickness of 4 mm; .*r >= 10 h0",
    ),
    "thickness in m": (
        f"{HEADER}\nua.csv,uniaxial,s1,10,0.0005\n",
        {},
        r"samples\.csv, row 2: thickness_mm is 0\.0005; between 0\.02 and 15 mm is expected, check the unit",
    ),
    "thickness in um": (f"{HEADER}\nua.csv,uniaxial,s1,10,500\n", {}, r"row 2: thickness_mm is 500"),
    "width in m": (
        f"{HEADER}\nua.csv,uniaxial,s1,0.01,0.5\n",
        {},
        r"row 2: width_mm is 0\.01; between 1 and 300",
    ),
    "no width": (f"{HEADER}\nua.csv,uniaxial,s1,,0.5\n", {}, r"row 2: width_mm is empty; .*fill it"),
    "unknown test": (f"{HEADER}\nua.csv,tension,s1,10,0.5\n", {}, r"row 2: test is 'tension'; one of"),
    "sample twice": (UA + "ua.csv,uniaxial,s1,10,0.5\n", {}, r"row 3: uniaxial sample 's1' is also in row 2"),
    "sample name": (f"{HEADER}\nua.csv,uniaxial,mean,10,0.5\n", {}, r"row 2: sample is 'mean'; use letters"),
    "no file": (
        f"{HEADER}\nub.csv,uniaxial,s1,10,0.5\n",
        {},
        r"row 2: file 'ub\.csv' is not in .*add it or drop",
    ),
    "unknown history": (
        f"{HEADER},history\nua.csv,uniaxial,s1,10,0.5,cycles\n",
        {},
        r"row 2: history is 'cycles'; one of \['monotonic', 'cyclic', 'relaxation'\]",
    ),
    "unknown correction": (
        f"{HEADER},corrections\nua.csv,uniaxial,s1,10,0.5,zero_force tow\n",
        {},
        r"corrections has \['tow'\]",
    ),
    "another load case": (
        f"{HEADER}\neb.csv,equibiaxial,s1,,0.5\n",
        {"eb": "time_s,pressure_kPa,apex_radius_mm,stretch_1,stretch_2\n0,0.3,60,1.2,1.2\n9,0.5,40,1.6,1\n"},
        r"eb\.csv, row 3: stretch_2 is 1 where equibiaxial has 1\.6 \(within 20%\)",
    ),
}


@pytest.mark.parametrize(("samples", "files", "message"), BAD.values(), ids=BAD.keys())
def test_bad_input_stops_with_file_row_value_limit_and_remedy(material, samples, files, message):
    with pytest.raises(TableError, match=message):
        read_material_tests(material(samples, **files))


def test_a_folder_is_read_with_its_separators_and_its_synthetic_mark(tmp_path, material):
    # A folder without samples is named
    with pytest.raises(TableError, match=r"samples\.csv: no such file"):
        read_material_tests(tmp_path)

    # Semicolons decimal commas and comments
    plain = read_material_tests(material())[0]
    text = "# rig 3\n" + uniaxial().replace(",", ";").replace(".", ",")
    assert_allclose(read_material_tests(material(ua=text))[0].cauchy_stress, plain.cauchy_stress, rtol=1e-15)

    # Synthetic tests are known by their comment
    assert not declared_synthetic(material())
    assert declared_synthetic(material(eb="# synthetic, not measured\n" + inflation()))
