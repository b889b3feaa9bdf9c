"""What a session would have recorded without error: against closed forms, and against what it did record."""

import numpy as np
import pytest
from artificial_truth import DEPTHS, small_lab, small_study, truth_cell
from numpy.testing import assert_allclose

from gelforge.indentation.cells.cell_file import write_cell
from gelforge.indentation.planning.plan import plan_cells
from gelforge.indentation.sensor.symmetry import transform_bins
from gelforge.recording.features import session_features
from gelforge.recording.readings import at_commanded_depth, read_recording
from gelforge.virtual_lab.particles import VirtualLabError
from gelforge.virtual_lab.session import make_session
from gelforge.virtual_lab.true_presses import View, true_presses

STUDY, LAB = small_study(), small_lab()
CELLS = plan_cells(STUDY)
CAMERA = LAB.camera
ABOVE_PINHOLE_MM = 44.0  # of the points at z = -2 mm


def at(x, y, z=-2.0):
    return np.array([[x, y, z]])


def test_pixels_move_as_their_nearest_particles_and_none_is_refused():
    # Every pixel moves as the particles where all move alike
    particles = np.random.default_rng(1).uniform([4, 4, -2], [28, 28, -2], (40, 3))
    flow = View.of(CAMERA, particles, 0.3).flow(particles + [0.11, -0.22, 0.0])
    scale = CAMERA.focal_px / ABOVE_PINHOLE_MM  # px per mm; the camera looks up, y is upwards in the image
    assert_allclose(np.abs(flow), np.broadcast_to([0.11 * scale, 0.22 * scale], flow.shape), rtol=1e-5)

    # A nearer particle hides a farther one and none is refused
    particles = np.concatenate([at(16, 16, -2), at(16, 16, -5), at(16, 24)])
    view = View.of(CAMERA, particles, 0.6)
    middle = np.rint(view.pixels[1]).astype(int)
    assert view.shown[middle[1], middle[0]] == 1
    other = np.rint(view.pixels[2]).astype(int)
    assert view.shown[other[1], other[0]] == 2
    assert set(np.unique(view.shown)) == {1, 2}  # the hidden one is nowhere shown
    halfway = (view.pixels[1] + view.pixels[2]) / 2
    nearer = np.rint(halfway + 0.2 * (view.pixels[2] - halfway)).astype(int)
    assert view.shown[nearer[1], nearer[0]] == 2

    # A camera that sees no particle is refused
    with pytest.raises(VirtualLabError, match="sees no particle; correct its pose"):
        View.of(CAMERA, at(200, 200), 0.3)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return readings, feature files and true presses of sessions whose force sensor has no error."""
    folder = tmp_path_factory.mktemp("recorded")
    for cell in CELLS.values():
        if cell.source is None:
            write_cell(folder / "truth" / f"{cell.name}.h5", truth_cell(cell.name, cell.x_mm, cell.y_mm))
    exact = LAB.force.model_copy(update={"noise_N": [0.0] * 3, "resolution_N": [1e-7] * 3})
    lab = LAB.model_copy(update={"force": exact})
    readings, features = {}, {}
    for session in lab.sessions:
        make_session(lab, session, STUDY, CELLS, folder / "truth", folder / session.session)
        recording = read_recording(folder / session.session, CELLS, STUDY.sensor)
        readings[session.session] = recording.readings
        session_features(recording, STUDY.features, folder / f"{session.session}.h5")
        features[session.session] = folder / f"{session.session}.h5"
    wanted = {(n, press, cell) for n, r in readings.items() for press, cell in zip(r["press"], r["cell"])}
    return readings, features, dict(true_presses(STUDY, lab, CELLS, folder / "truth", wanted))


def test_true_force_and_motion_of_the_images_are_those_of_the_solution(recorded):
    # The true force and the share of the contact point are exact. At the depth that was reached, of mirrored cells
    # too: 0.01 mm of the contact point are 4 mN
    readings, _, true = recorded
    for session, table in readings.items():
        held = table[at_commanded_depth(table) & (table["phase"] == "load")]
        assert len(held) == held["press"].nunique() == len(table["press"].unique())
        for row in held.itertuples():
            total = true[session, row.press].bin_force_N.sum(axis=0)
            assert_allclose(total, [row.fx_N, row.fy_N, row.fz_N], atol=1e-6)

    # The contact points share is the rest to the commanded depth
    table = readings["one"].drop_duplicates("press").set_index("press")
    sizes = []
    for press, row in table.iterrows():
        planned, depth = CELLS[row["cell"]], readings["one"].query("press == @press")["depth_mm"].max()
        own = truth_cell("any", *_source_xy(planned)).arrays["bin_force_N"][DEPTHS.index(depth)]
        expected = transform_bins(planned.symmetry, own, 20) if planned.symmetry else own
        found = true["one", press]
        assert_allclose(found.bin_force_N - found.contact_point_bin_N, expected, atol=1e-12)
        sizes.append(np.abs(found.contact_point_bin_N[:, 2]).sum())
    assert 1e-4 < np.mean(sizes) < 0.01  # 0.01 mm times 0.4 N/mm

    # The images show the true motion. The flow of the drawn images is the true motion but for a part of it: session
    # by session, mirrored cells too
    import h5py

    _, features, true = recorded
    for session, path in features.items():
        with h5py.File(path) as file:
            pressed = file["phase"].asstr()[()] != "zero"
            seen = _components(file["feature"][pressed])
            exact = _components(
                np.stack([true[session, press].feature for press in file["press"].asstr()[pressed]])
            )
        assert np.sqrt((exact**2).sum(-1).mean()) > 0.1  # px
        assert ((seen - exact) ** 2).sum() < 0.15 * (exact**2).sum()


def _source_xy(planned):
    source = CELLS[planned.source] if planned.source else planned
    return source.x_mm, source.y_mm


def _components(feature):
    magnitude, direction = np.split(feature, 2, axis=1)
    return np.stack([magnitude * np.cos(direction), magnitude * np.sin(direction)], axis=-1)


def test_a_press_of_another_lab_is_refused(recorded, tmp_path):
    name = next(iter(CELLS))
    with pytest.raises(
        VirtualLabError, match="session one: indentation p99999 of site .* record the session again"
    ):
        list(true_presses(STUDY, LAB, CELLS, tmp_path, [("one", "p99999", name)]))
