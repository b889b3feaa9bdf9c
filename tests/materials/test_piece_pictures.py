"""Material tests whose rows name pictures: read like any other, and everything left out is said."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from synthetic_pictures.membrane_views import MembraneFilm
from synthetic_pictures.speckle import TensileFilm

from gelforge.csv_table import TableError
from gelforge.materials.readers.material_tests import declared_synthetic, input_files, read_material_tests

MU = 0.03  # MPa, neo-Hookean truth
WIDTH, H0 = 10.0, 0.5  # mm
TENSION = np.linspace(1, 1.6, 13)
INFLATION = np.concatenate([[1.0], np.linspace(1.05, 1.6, 8)])


def write_tension(folder, film, lines=None, columns="time_s,force_N,image", extra="", values=""):
    folder.mkdir(exist_ok=True)
    force = MU * (film.stretch - film.stretch**-2) * WIDTH * H0
    rows = [f"{k}.0,{f:.6f},pictures/{k:03d}.png" for k, f in enumerate(force)]
    (folder / "pictures").mkdir(exist_ok=True)
    for k, frame in enumerate(film.frames()):
        cv2.imwrite(str(folder / "pictures" / f"{k:03d}.png"), frame)
    (folder / "ua.csv").write_text(
        "\n".join(["# synthetic", columns, *(lines(rows) if lines else rows)]) + "\n"
    )
    (folder / "samples.csv").write_text(
        f"file,test,sample,width_mm,thickness_mm{extra}\nua.csv,uniaxial,s1,{WIDTH},{H0}{values}\n"
    )
    return folder


@pytest.fixture(scope="module")
def membrane(tmp_path_factory):
    """Return a folder with the views of an inflation; each test states its own samples.csv."""
    folder = tmp_path_factory.mktemp("membrane")
    film = MembraneFilm(INFLATION, camera_distance_mm=150.0)
    lam = np.asarray(film.stretch)
    pressure = 2 * H0 * MU * (lam**2 - lam**-4) / lam**2 / film.radius_mm * 1e3  # kPa
    rows = []
    for k in range(len(lam)):
        cv2.imwrite(str(folder / f"top{k}.png"), film.top_view(k))
        cv2.imwrite(str(folder / f"side{k}.png"), film.side_view(k))
        rows.append(f"{k},{pressure[k]:.6f},top{k}.png,side{k}.png")
    (folder / "eb.csv").write_text("\n".join(["time_s,pressure_kPa,top_image,side_image", *rows]) + "\n")
    return folder


def stated(folder, extra, values):
    (folder / "samples.csv").write_text(
        f"file,test,sample,width_mm,thickness_mm{extra}\neb.csv,equibiaxial,s1,30,{H0}{values}\n"
    )
    return folder


@pytest.fixture(scope="module")
def strip(tmp_path_factory):
    return write_tension(
        tmp_path_factory.mktemp("m") / "strip", TensileFilm(TENSION, slip=0.05, shape=(140, 380))
    )


def test_tension_read_from_pictures(strip):
    (test,) = read_material_tests(strip)
    assert_allclose(test.stretch, TENSION, rtol=5e-3)  # the tracker's promise
    assert_allclose(test.nominal_stress, MU * (TENSION - TENSION**-2), atol=1e-6)  # rounding of the file
    assert "tracked in 13 pictures" in test.findings[0] and "found by its texture" in test.findings[0]
    assert declared_synthetic(strip)  # read from the tables only
    assert len(input_files(strip)) == 2 + 13  # pictures are inputs: a change of one changes the law


def test_rows_without_picture_or_texture_are_left_out_and_missing_columns_named(tmp_path):
    # A stated window and rows without picture are said
    film = TensileFilm(TENSION, shape=(140, 380))
    x, y, width, height = film.window
    folder = write_tension(
        tmp_path / "m",
        film,
        lambda rows: [*rows[:5], "4.5,0.05,", *rows[5:]],
        extra=",window_x_px,window_y_px,window_width_px,window_height_px,patch_px",
        values=f",{x},{y},{width},{height},25",
    )
    (test,) = read_material_tests(folder)
    assert_allclose(test.stretch, TENSION, rtol=5e-3)
    assert "1 rows without image left out" in test.findings[0]
    assert "as stated" in test.findings[1]

    # Lost frames are left out with their reason
    lost = tmp_path / "lost"
    lost.mkdir()
    contrast = np.ones(13)
    contrast[[4, 5]] = 0
    folder = write_tension(lost / "m", TensileFilm(TENSION, contrast=contrast, shape=(140, 380)))
    (test,) = read_material_tests(folder)
    assert_allclose(test.stretch, TENSION[contrast > 0], rtol=5e-3)
    assert_allclose(test.time_s, np.flatnonzero(contrast))
    (said,) = [s for s in test.findings if "left out" in s]
    assert "2 rows left out: row 7 (pictures/004.png): texture lost" in said

    # Neither stretch nor pictures still names the missing column
    nothing = tmp_path / "nothing"
    nothing.mkdir()
    folder = write_tension(
        nothing / "m", TensileFilm(TENSION[:2], shape=(140, 380)), columns="time_s,force_N,frame"
    )
    with pytest.raises(TableError, match="stretch_1"):
        read_material_tests(folder)


def test_inflation_read_from_two_views(membrane):
    (test,) = read_material_tests(stated(membrane, ",mm_per_px,camera_distance_mm", ",0.1,150"))
    lam = INFLATION[1:]  # the flat membrane has no radius
    assert_allclose(test.stretch, lam, rtol=5e-3)
    # p r lam1 lam2 / (2 h0) / lam1: stretch 0.5 %, radius 0.2 %
    assert_allclose(test.nominal_stress, MU * (lam**2 - lam**-4) / lam, rtol=7e-3)
    said = " ".join(test.findings)
    assert "1 rows left out: row 2 (side0.png)" in said and "too flat" in said
    assert "divided by up to 1.1" in said

    # A telecentric top view is said to be assumed
    (test,) = read_material_tests(stated(membrane, ",mm_per_px", ",0.1"))
    assert any("telecentric" in s for s in test.findings)
    apparent = MembraneFilm(INFLATION, camera_distance_mm=150.0).apparent_stretch[
        1:
    ]  # what the pictures show
    assert_allclose(test.stretch, apparent, rtol=5e-3)


@pytest.mark.parametrize(
    ("extra", "values", "words"),
    [
        ("", "", "mm_per_px of eb.csv is missing"),
        (",mm_per_px", ",-1", "mm_per_px of eb.csv is -1"),
        (",mm_per_px,camera_distance_mm", ",0.1,0.15", "camera_distance_mm of eb.csv is 0.15, the apex is"),
    ],
)
def test_an_inflation_without_its_scale_is_refused(membrane, extra, values, words):
    with pytest.raises(TableError, match=words):
        read_material_tests(stated(membrane, extra, values))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda rows: [r.replace("007.png", "absent.png") for r in rows],
            r"row 10: .*absent.png: no readable picture",
        ),
        (lambda rows: [r.rsplit(",", 1)[0] + "," for r in rows], "image is empty in every row"),
        (lambda rows: rows[:3], "3 pictures could be measured, 5 at least"),
        (
            lambda rows: [*rows[:4], rows[4].replace("004", "odd"), *rows[5:]],
            "odd.png has 100 x 100 px, the first",
        ),
    ],
)
def test_what_cannot_be_tracked_is_refused(tmp_path, change, words):
    folder = write_tension(tmp_path / "m", TensileFilm(TENSION, shape=(140, 380)), change)
    cv2.imwrite(str(folder / "pictures" / "odd.png"), np.zeros((100, 100), np.uint8))
    with pytest.raises(TableError, match=words):
        read_material_tests(folder)
