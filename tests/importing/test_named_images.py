"""A folder of images whose names hold the numbers becomes a session."""

import cv2
import numpy as np
import pytest
import yaml

from gelforge.cli import main
from gelforge.config import ConfigError
from gelforge.config.foreign.named_images import NamedImages, load_names
from gelforge.importing.named_images import named_readings
from gelforge.importing.refusals import ImportingError
from gelforge.recording.readings import read_recording

NAMES = "x{x_mm}_y{y_mm}_z{depth_mm}_f{fz_N}.png"
PLACES, DEPTHS = ((10.0, 12.5), (14.0, 9.0), (18.0, 9.0)), (0.5, 1.0, 1.5)


def speckle(seed=0):
    rng = np.random.default_rng(seed)
    grey = rng.integers(0, 255, (60, 80)).astype(np.uint8)
    return cv2.resize(cv2.GaussianBlur(grey, (0, 0), 1.5), (160, 120))


def moved(image, px):
    """Return an image stretched about its middle, which moves by so much at its sides."""
    scale = 1 + px / 80
    turn = np.array([[scale, 0, 80 * (1 - scale)], [0, scale, 60 * (1 - scale)]])
    return cv2.warpAffine(image, turn, (160, 120), borderMode=cv2.BORDER_REFLECT)


def force(k, depth):
    return -(1.1 + 0.05 * k) * depth**1.5


@pytest.fixture
def folder(tmp_path):
    image = speckle()
    (tmp_path / "pictures").mkdir()
    cv2.imwrite(str(tmp_path / "pictures" / "ref.png"), image)
    for k, (x, y) in enumerate(PLACES):
        for depth in DEPTHS:
            name = f"x{x}_y{y}_z{depth}_f{force(k, depth):.4f}.png"
            cv2.imwrite(str(tmp_path / "pictures" / name), moved(image, 2 * depth + 0.1 * k))
    return tmp_path


def mapping(folder, names=NAMES, **images):
    content = {
        "describes": "images of a test",
        "images": {"folder": "pictures", "names": names, "reference": "ref.png", **images},
        "session": {"force": {"acts_on": "sensor", "resolution_N": [0.001, 0.001, 0.001]}},
    }
    path = folder / "names.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


def test_a_folder_of_images_becomes_a_session_and_a_returning_depth_an_indentation(folder, capsys):
    # A folder of images alone becomes a session
    assert main(["import", str(mapping(folder)), "--out", str(folder / "recordings" / "monday")]) == 0
    assert "12 readings, 9 images" in capsys.readouterr().out
    session = read_recording(folder / "recordings" / "monday")
    readings = session.readings[session.readings["phase"] == "load"]
    for k, (x, y) in enumerate(PLACES):
        own = readings[(readings["x_mm"] == x) & (readings["y_mm"] == y)]
        np.testing.assert_allclose(own["depth_mm"], DEPTHS)
        np.testing.assert_allclose(own["fz_N"], [force(k, d) for d in DEPTHS], atol=5e-5)
        assert own["press"].nunique() == 1
    for name in readings["image"]:
        copy = folder / "recordings" / "monday" / "images" / name
        assert copy.read_bytes() == (folder / "pictures" / name).read_bytes()
    assert (folder / "recordings" / "monday" / "reference.png").is_file()

    # A depth that returns is the next indentation
    for path in sorted((folder / "pictures").glob("x10*.png")):
        again = path.stem.rpartition("_")[0] + "_f-1.5.png"
        path.with_name(again).write_bytes(path.read_bytes())
    table = named_readings(folder, load_names(mapping(folder)).images)
    assert table[table["x_mm"] == 10]["press"].nunique() == 2
    assert table.groupby("press")["depth_mm"].apply(list).map(lambda d: d == list(DEPTHS)).all()


def test_units_other_quantities_and_anything(folder):
    """The same numbers in other units, sideways forces, a counter and the name of an indentation."""
    for number, path in enumerate(sorted((folder / "pictures").glob("x*.png"))):
        x, y, z, f = (float(part[1:]) for part in path.stem.split("_"))
        press = f"run-{PLACES.index((x, y))}"
        path.rename(
            path.with_name(
                f"{press}_{number:04d}_{1e3 * x:.0f}_{y}_{z / 10}cm_0.01_-0.02_{1e3 * f:.1f}mN.PNG"
            )
        )
    names = "{press}_{}_{x_um}_{y_mm}_{depth_cm}cm_{fx_N}_{fy_N}_{fz_mN}mN.png"
    table = named_readings(folder, load_names(mapping(folder, names)).images)
    assert set(table["press"]) == {"run-0", "run-1", "run-2"}
    for k, (x, y) in enumerate(PLACES):
        own = table[table["press"] == f"run-{k}"]
        np.testing.assert_allclose(own[["x_mm", "y_mm"]], [(x, y)] * 3)
        np.testing.assert_allclose(own["depth_mm"], DEPTHS)
        np.testing.assert_allclose(own["fz_N"], [force(k, d) for d in DEPTHS], atol=1e-4)
        assert (own["fx_N"] == 0.01).all() and (own["fy_N"] == -0.02).all()


def test_times_tell_indentations_and_unloading(folder):
    for path in (folder / "pictures").glob("x*.png"):
        path.unlink()
    course = [(10, 0.0), (10, 0.5), (10, 1.0), (10, 0.5), (10, 0.0), (10, 0.5), (14, 0.5)]
    for t, (x, depth) in enumerate(course):
        cv2.imwrite(str(folder / "pictures" / f"t{t}_x{x}_y5_z{depth}_f{-depth}.png"), speckle(t))
    table = named_readings(
        folder, NamedImages(folder="pictures", names=f"t{{time_s}}_{NAMES}", reference="ref.png")
    )
    assert list(table["press"]) == ["p0001"] * 4 + ["p0002"] * 2 + ["p0003"]
    assert list(table["time_s"]) == list(range(7))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("x{x_mm}_y{y_mm}_f{fz_N}.png", "names holds no depth; a session needs"),
        ("x{x_mm}_y{y_mm}_z{depth_mm}.png", "names holds no fz"),
        ("x{x_mm}_y{y_mm}_z{depth_N}_f{fz_N}.png", r"\{depth_N\} is no quantity with its unit"),
        ("x{x_mm}_y{y_mm}_z{depth_mm}_f{force}.png", r"\{force\} is no quantity"),
        ("x{x_mm}_x{x_mm}_y{y_mm}_z{depth_mm}_f{fz_N}.png", "names holds x twice"),
    ],
)
def test_names_that_say_too_little(folder, names, said):
    with pytest.raises(ConfigError, match=said):
        load_names(mapping(folder, names))


def test_what_does_not_fit_the_description_is_refused(folder):
    (folder / "pictures" / "x1_y2_zdeep_f3.png").write_bytes(b"")
    with pytest.raises(ImportingError, match=r"x1_y2_zdeep_f3\.png: is not of the form"):
        named_readings(folder, load_names(mapping(folder)).images)
    (folder / "pictures" / "x1_y2_zdeep_f3.png").unlink()
    assert main(["import", str(mapping(folder, reference=None)), "--out", str(folder / "s1")]) != 0
    assert not (folder / "s1").exists()

    # Logs are not taken for names
    path = mapping(folder)
    path.write_text(path.read_text() + "stage: {file: a.csv}\n")
    with pytest.raises(ConfigError, match="images are described, and stage"):
        load_names(path)
    path.write_text("describes: logs\nforce: {}\n")
    assert load_names(path) is None
