"""Any indenter along any path: forces, node states, what lies on the sides, and what is refused before solving."""

from dataclasses import replace

import meshio
import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.cli.by_hand.press import torque_about_centre
from gelforge.config import ConfigError
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.planning.plan import plan_cells, press_path
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.contact.forces import OPEN, SLIP, STICK
from gelforge.mechanics.laws.models.yeoh import Yeoh

LAWS = specimens.STUDY_LAWS
CENTRE = specimens.CENTRE
MESH = {"near_mm": 0.7, "near_radius_mm": 2.0, "growth": 0.4, "far_mm": 2.0}
FACES = [
    [0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7], [0, 1, 5], [0, 5, 4],
    [1, 2, 6], [1, 6, 5], [2, 3, 7], [2, 7, 6], [3, 0, 4], [3, 4, 7],
]  # fmt: skip
BLOCK = np.array([[x, y, z] for z in (0, 5) for x, y in ((-2, -1.5), (2, -1.5), (2, 1.5), (-2, 1.5))], float)


def write_surface(path, vertices=BLOCK, triangles=FACES):
    meshio.write(path, meshio.Mesh(np.asarray(vertices, float), [("triangle", np.array(triangles))]))
    return path


def pressed(indenter=None, path=None, depths=(0.3, 0.6), place=CENTRE, sensor=None, **mechanics):
    """Return the cell of one indenter at one position, along a path of (depth, shear, tilt) or straight down."""
    study = specimens.study(indenter=indenter, sensor=sensor, **({"mesh": MESH} | mechanics))
    planned = PlannedCell("press", *place, tuple(depths))
    if path is not None:
        steps = [(depth, shear, tilt) for depth, shear, tilt in path]
        d, s, t = zip(*steps)
        planned = PlannedCell("press", *place, d, phases=("load",) * len(d), shears_mm=s, tilts_deg=t)
    return simulate_cell(study, LAWS, planned)


def sound(cell):
    """Fail unless a cell converged, balances, and its parts add up."""
    a = cell.arrays
    assert cell.converged, cell.attributes["reason"]
    assert max(cell.attributes["force_balance"]) < 1e-6
    size = np.linalg.norm(a["total_force_N"], axis=1).max()
    # Bins drop dust of 1e-9 N each.
    assert_allclose(a["bin_force_N"].sum(axis=1) + a["side_force_N"], a["total_force_N"], atol=1e-6 * size)
    return a


INDENTERS = {
    "flat cylinder": {"kind": "cylinder", "radius_mm": 2.0, "length_mm": 6.0, "edge_radius_mm": 0.3},
    "round cylinder on its side": {
        "kind": "cylinder", "radius_mm": 3.0, "length_mm": 8.0, "edge_radius_mm": 0.5,
        "orientation_deg": [90.0, 0.0, 0.0],
    },
    "box": {"kind": "box", "size_mm": [4.0, 3.0, 5.0], "edge_radius_mm": 0.5},
    "box turned": {
        "kind": "box", "size_mm": [4.0, 3.0, 5.0], "edge_radius_mm": 0.5, "orientation_deg": [4.0, -3.0, 30.0],
    },
    "ridge": {"kind": "mesh", "file": "config/indenters/wedge.stl", "edge_radius_mm": 0.6},
    "two balls": {
        "kind": "several",
        "parts": [
            {"kind": "sphere", "radius_mm": 3.0, "offset_mm": [-2.5, 0.0, 0.0]},
            {"kind": "sphere", "radius_mm": 3.0, "offset_mm": [2.5, 0.0, 0.2]},
        ],
    },
}  # fmt: skip


@pytest.mark.parametrize("indenter", INDENTERS.values(), ids=INDENTERS.keys())
def test_every_indenter_presses(indenter):
    cell = pressed(indenter)
    a = sound(cell)
    assert (np.diff(a["total_force_N"][:, 2], prepend=0.0) < 0).all()
    touched = a["node_state"][-1] > OPEN
    assert touched.sum() >= 5
    assert not np.linalg.norm(a["node_normal_N"][-1][~touched], axis=1).any()
    assert not any(cell.attributes["side_contact"])


def test_bodies_of_files_and_of_parts_press_as_their_formulas_do(tmp_path):
    # A box from a file presses as the box does. The same solid as a formula and as 12 triangles: the signed
    # distances are equal to rounding, so are the forces
    file = {"kind": "mesh", "file": str(write_surface(tmp_path / "block.stl")), "edge_radius_mm": 0.5}
    known = pressed(INDENTERS["box"]).arrays
    found = pressed(file).arrays
    # STL holds single precision: 1e-7 of 5 mm.
    assert_allclose(
        found["total_force_N"], known["total_force_N"], atol=1e-5 * abs(known["total_force_N"]).max()
    )
    assert np.array_equal(found["node_state"], known["node_state"])

    # Two balls press where they are. The higher ball presses less, by what its own depth makes; a third ball far
    # above changes nothing
    two = INDENTERS["two balls"]
    a = pressed(two).arrays
    left = a["node_xy_mm"][:, 0] < CENTRE[0]
    halves = [-a["node_normal_N"][-1][side, 2].sum() for side in (left, ~left)]
    assert 0.3 < halves[1] / halves[0] < 0.7  # Hertz: (0.4/0.6)^1.5 = 0.54
    far = {"kind": "sphere", "radius_mm": 1.0, "offset_mm": [0.0, 0.0, 5.0]}
    three = pressed(two | {"parts": [*two["parts"], far]}).arrays
    assert_allclose(three["total_force_N"], a["total_force_N"], rtol=1e-12)


# -------------------------------------------------------------------------------------------------------------- paths
def simulated(path, **mechanics):
    return simulate_cell(specimens.study(mesh=MESH, **mechanics), LAWS, path)


def test_shear_sticks_then_slips_and_release_takes_all_away():
    """Load, shear beyond sliding, unload to nothing: the friction follows Coulomb, and no force stays on a released gel."""
    mu = 0.3
    path = press_path("press", *CENTRE, [0.3, 0.6], [1.2, 0.0], unload=True)
    cell = simulated(path, friction=mu)
    a, phases = sound(cell), np.array(cell.attributes["phases"])
    assert list(dict.fromkeys(phases)) == ["load", "shear", "unload"]
    shear = np.flatnonzero(phases == "shear")
    fx = a["total_force_N"][:, 0]
    # the mesh is finer towards where it will be moved, walls too
    assert np.abs(fx[phases == "load"]).max() < 5e-3 * np.abs(a["total_force_N"][:, 2]).max()
    early, late = shear[0], shear[-1]
    assert (a["node_state"][early] == STICK).any()
    assert fx[early] > 0  # moved along +x the indenter drags the sensor along
    state, touched = a["node_state"][late], a["node_state"][late] > OPEN
    assert (state[touched] == SLIP).all()
    normal, friction = (
        np.linalg.norm(a[name][late][touched], axis=1) for name in ("node_normal_N", "node_shear_N")
    )
    assert_allclose(friction, mu * normal, rtol=1e-9)
    gained = np.diff(fx[shear])
    assert gained[-1] < 0.2 * gained[0]  # it slides as a whole
    assert phases[-1] == "unload"
    assert a["depth_mm"][-1] == 0.0
    assert not a["node_state"][-1].any()
    assert not a["total_force_N"][-1].any()
    assert np.abs(a["reaction_N"][-1]).max() < 1e-7  # N: what the iteration leaves of a body without load
    assert np.abs(a["node_displacement_mm"][-1]).max() < 1e-5


def test_a_twist_turns_in_steps_against_the_torque_of_friction():
    # A twist by hand turns in steps of a degree after the shear
    path = press_path("press", *CENTRE, [0.3], [0.15, 0.0], unload=True, twist=-2.5)
    assert path.phases == ("load", "shear", "shear", "twist", "twist", "twist", "unload")
    assert_allclose(path.twists_deg, [0, 0, 0, -2.5 / 3, -5 / 3, -2.5, -2.5])
    assert path.shears_mm[-1] == (0.15, 0.0)

    # The torque of a twist resists it and is that of friction once all slips. A flat punch that slips all over:
    # torque mu sum(N r), of each node's own pressure and distance
    mu, punch = 0.2, {"kind": "cylinder", "radius_mm": 2.5, "edge_radius_mm": 0.3}
    path = press_path("press", *CENTRE, [0.3], None, unload=False, twist=25.0)
    a = sound(simulate_cell(specimens.study(mesh=MESH, friction=mu, indenter=punch), LAWS, path))
    torque = torque_about_centre(a)
    assert abs(torque[0]) < 1e-3 * torque[-1]
    assert (np.diff(torque)[:5] > 0).all()  # the punch drags the gel round with it
    state, touched = a["node_state"][-1], a["node_state"][-1] > OPEN
    assert (state[touched] == SLIP).mean() > 0.9
    arm = a["node_xy_mm"] + a["node_displacement_mm"][-1][:, :2] - a["indenter_mm"][-1][:2]
    normal = np.linalg.norm(a["node_normal_N"][-1], axis=1)
    assert torque[-1] == pytest.approx(mu * (normal * np.linalg.norm(arm, axis=1)).sum(), rel=0.05)


def test_an_elastic_gel_dwells_without_change_and_slips_back_on_release():
    # An elastic gel dwells without change
    path = PlannedCell("press", *CENTRE, (0.5, 0.5), phases=("load", "dwell"))
    a = sound(simulated(path))
    for name in ("total_force_N", "bin_force_N", "node_displacement_mm"):
        # The second state starts from the first, already within the stopping rule of 1e-6 of the force.
        assert_allclose(a[name][1], a[name][0], atol=2e-6 * np.abs(a[name][0]).max())

    # Unloading slips back and lets nodes go. In unloading the contact shrinks and friction turns round: another
    # state than on loading, less force
    path = press_path("press", *CENTRE, [0.2, 0.4, 0.6], None, unload=True)
    a = sound(simulated(path, friction=0.05))
    down, up = a["total_force_N"][1, 2], a["total_force_N"][3, 2]
    assert abs(up) < abs(down)
    counts = (a["node_state"] > OPEN).sum(axis=1)
    assert counts[2] > counts[3] > counts[4] > counts[5]
    # Back at the first touch the last node may stay at a gap of zero, without a force to speak of.
    assert np.abs(a["total_force_N"][5]).max() < 1e-5 * abs(down)
    assert (a["node_state"][3] == SLIP).any()


def test_an_indenter_that_turns_rubs_and_leans():
    """A ball turned about its centre is the same ball: no change without friction; with it, about y, a drag along x."""
    turn = [(0.5, (0.0, 0.0), (0.0, 0.0)), (0.5, (0.0, 0.0), (0.0, 4.0))]
    smooth, rough = (pressed(path=turn, friction=mu).arrays["total_force_N"] for mu in (0.0, 0.45))
    assert_allclose(smooth[1], smooth[0], atol=1e-6 * abs(smooth[0, 2]))
    # Turned about +y its lowest point moves along -x and drags the sensor with it.
    assert rough[1, 0] < -0.02 * abs(rough[0, 2])
    assert abs(rough[1, 1]) < 0.05 * abs(rough[1, 0])

    # A box that tilts presses harder on its lower side
    turn = [(0.4, (0.0, 0.0), (0.0, 0.0)), (0.4, (0.0, 0.0), (0.0, 3.0))]
    a = sound(pressed(INDENTERS["box"], path=turn, friction=0.0))
    right = a["node_xy_mm"][:, 0] > CENTRE[0] + 1e-9
    left = a["node_xy_mm"][:, 0] < CENTRE[0] - 1e-9
    share = [a["node_normal_N"][k][side, 2].sum() for k in (0, 1) for side in (left, right)]
    assert share[0] == pytest.approx(share[1], rel=1e-6)  # upright: symmetric
    assert share[3] < 1.3 * share[2] < 0  # a turn about +y lowers the side of larger x


def test_force_on_the_side_faces_is_stored_apart_and_flagged():
    """A ball that comes down next to the edge touches the rim first, then the side, and pushes it inwards."""
    beside = {"kind": "sphere", "radius_mm": 2.0, "offset_mm": [-2.2, 0.0, 0.0]}
    above = {
        "kind": "sphere",
        "radius_mm": 1.0,
        "offset_mm": [0.0, 0.0, 4.0],
    }  # the position must lie on the sensor
    indenter = {"kind": "several", "parts": [beside, above]}
    # Without friction: a rim that sticks is drawn down with the ball, and the side does not come to it.
    cell = pressed(indenter, depths=(0.9, 1.2, 1.5, 1.8), place=(0.5, 8.0), friction=0.0)
    side = sound(cell)["side_force_N"]
    assert list(cell.attributes["side_contact"]) == [False, False, True, True]
    assert not side[:2].any()
    assert side[3, 0] > side[2, 0] > 0
    assert not pressed(place=CENTRE).arrays["side_force_N"].any()


# ---------------------------------------------------------------------------------------------------------- bad input
def plan_of(depths, indenter=None, **mechanics):
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": list(depths)}
    return plan_cells(specimens.study(plan, indenter=indenter, **mechanics))


@pytest.mark.parametrize(
    ("depths", "indenter", "words"),
    [
        ([0.5, 2.5], {}, r"depth 2\.5 mm is beyond 0\.6 of the soft height 4\.0 mm; press less deep"),
        (
            [1.5],
            {"radius_mm": 1.2},
            r"1\.5 mm is beyond the widest part of the ball of radius 1\.2 mm, 1\.2 mm above",
        ),
        (
            [0.02],
            {},
            r"touches only 0\.3\d* mm to each side.*near_mm 1 mm\); take a finer mesh or press deeper",
        ),
        (
            [0.5],
            {"kind": "cylinder", "radius_mm": 2.0, "length_mm": 5.0, "edge_radius_mm": 0.1},
            r"edge_radius_mm 0\.1 of the cylinder is sharp.*near_mm 1 mm \(limit 0\.2 mm\)",
        ),
        (
            [0.2],
            {"kind": "box", "size_mm": [4.0, 4.0, 4.0], "orientation_deg": [45.0, 35.0, 0.0]},
            r"finer mesh, or an orientation_deg in which no edge or corner comes first",
        ),
    ],
)
def test_a_press_that_cannot_be_solved_is_refused_by_the_plan(depths, indenter, words):
    with pytest.raises(ConfigError, match=words):
        plan_of(depths, indenter)


def test_an_open_missing_or_unreadable_surface_is_named(tmp_path):
    path = write_surface(tmp_path / "open.stl", triangles=FACES[:-1])
    with pytest.raises(
        ConfigError, match=r"open\.stl: the surface is not closed: 3 open edges.*close the holes"
    ):
        plan_of([0.5], {"kind": "mesh", "file": str(path)})

    # A missing and an unreadable surface are named
    with pytest.raises(ConfigError, match=r"nowhere\.stl: no such file"):
        plan_of([0.5], {"kind": "mesh", "file": str(tmp_path / "nowhere.stl")})
    (tmp_path / "text.stl").write_text("no surface at all")
    with pytest.raises(ConfigError, match=r"text\.stl: .*save"):
        plan_of([0.5], {"kind": "mesh", "file": str(tmp_path / "text.stl")})


def test_an_unstable_law_or_a_start_inside_the_gel_is_refused_before_solving(monkeypatch):
    """Yeoh with a negative second term, as a fit to small strains may give it."""
    bad = Yeoh(0.05, -0.15, 0.0)
    with pytest.raises(
        ConfigError,
        match=r"skin.*unstable.*from stretch 1\.\d+.*press less deep or fit another constitutive model",
    ):
        simulate_cell(specimens.study(), LAWS | {"stiff": bad}, PlannedCell("a", *CENTRE, (0.5, 1.0)))

    # An indenter that starts inside the gel is refused
    from gelforge.indentation.solving import simulate

    lower = simulate.model_of

    def sunk(*given, **named):
        model = lower(*given, **named)
        return replace(model, start=model.start - [0.0, 0.0, 0.2])

    monkeypatch.setattr(simulate, "model_of", sunk)
    with pytest.raises(ConfigError, match=r"starts 0\.2 mm inside the gel.*correct its offset_mm"):
        pressed()
