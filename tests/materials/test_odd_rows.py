"""Rows that cannot belong to a curve are refused, and honest curves that resemble them are not."""

import numpy as np
import pytest

from gelforge.config import ConfigError
from gelforge.csv_table import TableError
from gelforge.materials.basis.common_form import MaterialTest, Segment
from gelforge.materials.plausibility.odd_rows import check_copies, check_rows
from gelforge.materials.readers.mapped_files import read_microindentation
from gelforge.materials.readers.material_tests import read_material_tests
from gelforge.materials.small_tests.trials import sheet_thickness, static_friction

G = 0.05  # MPa
LAM = np.linspace(1.0, 2.0, 50)


def curve(lam=LAM, change=None, noise=0.01, segments=None, seed=0):
    """Return a strip whose stress scatters by a share of its largest, with some rows changed."""
    stress = G * (lam - lam**-2)
    stress = stress + noise * stress.max() * np.random.default_rng(seed).normal(size=len(lam))
    for row, factor in (change or {}).items():
        stress[row] *= factor
    segments = segments or (Segment("load", 0, len(lam), 1),)
    return MaterialTest("uniaxial", "a", lam, stress, segments=segments, source="a.csv")


def checked(test, **more):
    check_rows("a.csv", range(2, 2 + len(test.stretch)), test, "or keep it", **more)


@pytest.mark.parametrize(
    ("row", "factor"), [(25, 1e3), (25, 1e-3), (30, -1.0), (49, 1e-3), (49, 1e3), (40, 1.4)]
)
def test_a_single_row_far_off_is_refused(row, factor):
    with pytest.raises(
        TableError, match=rf"a.csv, row {row + 2}: .* far off the neighbouring rows.*or keep it"
    ):
        checked(curve(change={row: factor}, noise=0.001))


def test_noise_steps_and_the_turn_of_a_cycle_pass():
    for seed in range(30):
        checked(curve(noise=0.05, seed=seed))
    slipped = curve(change={row: 0.8 for row in range(25, 50)}, noise=0.001)  # the clamp slipped
    checked(slipped)
    cycle = np.r_[np.linspace(1, 2, 12), np.linspace(2, 1, 12)[1:]]  # twelve rows a way: its turn is sharp
    checked(curve(cycle, noise=0.0, segments=(Segment("load", 0, 12, 1), Segment("unload", 11, 23, 1))))


def test_a_start_that_bears_stress_is_refused_unless_the_force_is_zeroed():
    loaded = curve(noise=0.0)
    loaded = MaterialTest(**{**vars(loaded), "nominal_stress": loaded.nominal_stress + 2 * G})
    with pytest.raises(TableError, match=r"of the largest stress is there before a tenth of the strain"):
        checked(loaded)
    checked(loaded, zeroed=True)
    soft = MaterialTest(
        **{**vars(loaded), "nominal_stress": G * np.sqrt(LAM - 1)}
    )  # much softer as it is pulled
    checked(soft)

    # Of an inflation whose time stands as pressure, 32 % of the largest stress are there before a
    # tenth of the strain.
    lam = np.linspace(1.0, 1.8, 60)[1:]
    time = MaterialTest(
        "equibiaxial", "a", lam, lam * lam, segments=(Segment("load", 0, 59, 1),), source="a.csv"
    )
    with pytest.raises(
        TableError, match=r"lead to 3\d% of the largest stress at stretch 1; 20% at most .*or keep it"
    ):
        checked(time)
    checked(time, zeroed=True)
    stiff = (
        G * (lam - 1) ** 0.25
    )  # a filled rubber, softer as it is pulled: 47 % before a tenth of the strain
    checked(MaterialTest("uniaxial", "a", lam, stiff, segments=(Segment("load", 0, 59, 1),), source="a.csv"))
    untared = MaterialTest(**{**vars(curve(noise=0.001)), "nominal_stress": G * (LAM - LAM**-2 + 0.15)})
    checked(untared)  # a load cell's zero of 9 %: a matter of `zero_force`, not of the columns


def test_copies_are_refused_and_a_row_that_is_right_can_be_confirmed(tmp_path):
    # Copies are refused and like samples are not
    one, two = curve(), curve(seed=1)
    check_copies("gel", [one, two])
    with pytest.raises(
        TableError, match=r"gel: uniaxial a \(a.csv\) and uniaxial b \(b.csv\) hold the same values"
    ):
        check_copies("gel", [one, MaterialTest(**{**vars(one), "sample": "b", "source": "b.csv"})])

    # Trials and sections count once
    (tmp_path / "friction.csv").write_text("trial,tilt_deg\n1,24\n2,25\n3,24\n2,25\n")
    with pytest.raises(TableError, match="row 5: trial 2 stands twice"):
        static_friction(tmp_path / "friction.csv")
    (tmp_path / "thickness.csv").write_text(
        "sample,section,thickness_mm\n1,1,2\n1,2,2\n1,3,2\n2,1,2\n2,2,2\n2,2,2\n"
    )
    with pytest.raises(TableError, match="row 7: sample 2, section 2 stands twice"):
        sheet_thickness(tmp_path / "thickness.csv")
    (tmp_path / "friction.csv").write_text("trial,tilt_deg\n1,24\n2,24\n3,24\n")
    assert static_friction(tmp_path / "friction.csv").count == 3

    # A row that is right is confirmed in samples csv
    force = 20 * G * (LAM - LAM**-2)
    assert len(own_format(tmp_path / "gel", force)) == 1
    force[30] *= 0.5
    with pytest.raises(
        TableError, match=r"a.csv, row 32: .*`keep_odd_rows` among the corrections in samples.csv"
    ):
        own_format(tmp_path / "gel", force)
    assert len(own_format(tmp_path / "gel", force, "keep_odd_rows")) == 1


def own_format(folder, force, corrections=""):
    folder.mkdir(exist_ok=True)
    rows = [f"{i},{f:.6g},{a:.6g}" for i, (f, a) in enumerate(zip(force, LAM))]
    (folder / "a.csv").write_text("\n".join(["time_s,force_N,stretch_1", *rows]) + "\n")
    (folder / "samples.csv").write_text(
        f"file,test,sample,width_mm,thickness_mm,corrections\na.csv,uniaxial,1,10,2,{corrections}\n"
    )
    return read_material_tests(folder)


def test_a_press_that_is_swapped_or_off_is_refused(tmp_path):
    z = np.linspace(0, 0.3, 100)
    force = 0.2 * np.maximum(z - 0.05, 0) ** 1.5 + 1e-4 * np.random.default_rng(0).normal(size=100)
    (tmp_path / "p.yaml").write_text("ball_radius_mm: 2\n")
    for names, right in (("depth_mm,force_N", True), ("force_N,depth_mm", False)):
        (tmp_path / "p.csv").write_text("\n".join([names, *(f"{a:.6g},{b:.6g}" for a, b in zip(z, force))]))
        if right:
            assert read_microindentation(tmp_path / "p.csv")
        else:
            with pytest.raises(TableError, match="swapped|turns back|plausible|grow with depth"):
                read_microindentation(tmp_path / "p.csv")

    # A press with a row or a unit that is off is refused and confirmed
    force = 0.15 * np.maximum(z - 0.05, 0) ** 1.5 + 2e-5 * np.random.default_rng(0).normal(size=100)
    assert len(ball(tmp_path, z, force).force_N) == 100
    spoilt = force * np.where(np.arange(100) == 80, 1e-3, 1)
    with pytest.raises(TableError, match="row 82: a force of .* far off the neighbouring rows"):
        ball(tmp_path, z, spoilt)
    assert len(ball(tmp_path, z, spoilt, "ball_radius_mm: 2\nodd_rows: keep\n").force_N) == 100
    with pytest.raises(TableError, match="Young's modulus of some .* MPa"):
        ball(tmp_path, z / 1000, force)
    with pytest.raises(ConfigError, match="ball_radius_mm, found 2000"):
        ball(tmp_path, z, force, "ball_radius_mm: 2000\n")


def ball(folder, z, force, sidecar="ball_radius_mm: 2\n"):
    folder.mkdir(exist_ok=True)
    (folder / "p.csv").write_text(
        "\n".join(["depth_mm,force_N", *(f"{a:.9g},{b:.9g}" for a, b in zip(z, force))])
    )
    (folder / "p.yaml").write_text(sidecar)
    return read_microindentation(folder / "p.csv")[0]
