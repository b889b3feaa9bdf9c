"""Where effects enter, one by one, against closed forms and limits."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError, study_from
from gelforge.config.basis.variants import merged
from gelforge.config.parts.materials import Material
from gelforge.indentation.effects.catalogue import CATALOGUE, Place, with_keys
from gelforge.indentation.effects.geometry import moved_mesh
from gelforge.indentation.effects.kinematics import plane_touch, real_place, yielding
from gelforge.indentation.effects.material import check_laws, region_bulk, region_laws
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.sensor.sensor_mesh import sensor_mesh
from gelforge.indentation.solving.model import model_of
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.materials.characterise import given_law
from gelforge.materials.fitting.law_file import read_law, write_law
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.gent import Gent
from gelforge.mechanics.laws.models.mooney_rivlin import MooneyRivlin
from gelforge.mechanics.laws.models.neo_hooke import NeoHooke
from gelforge.mechanics.laws.models.ogden import Ogden
from gelforge.mechanics.laws.models.yeoh import Yeoh

LAWS = specimens.STUDY_LAWS
BY_LAYER = {"gel": specimens.GEL, "skin": specimens.SKIN}
TIGHT = {"solver": {"force_tolerance": 1e-9, "gap_tolerance": 1e-9, "max_iterations": 80}}
PLANNED = PlannedCell("place", *specimens.CORNER, (0.4,))


def study(**mechanics):
    return specimens.study(**(TIGHT | mechanics))


def force(described, laws=LAWS, planned=PLANNED):
    cell = simulate_cell(described, laws, planned)
    assert cell.converged, cell.attributes["reason"]
    return cell.arrays["total_force_N"][-1]


def mesh_of(described):
    return sensor_mesh(
        described.sensor,
        described.mechanics.mesh,
        *specimens.CORNER,
        base=described.mechanics.effects.geometry.base,
    )


# ------------------------------------------------------------------------------------------------------- laws
@pytest.mark.parametrize(
    ("law", "same"),
    [
        ({"law": "neo_hooke", "mu_kPa": 12.0}, Ogden((12e-3,), (2.0,))),
        ({"law": "mooney_rivlin", "C10_kPa": 5.0, "C01_kPa": 1.0}, Ogden((10e-3, -2e-3), (2.0, -2.0))),
        ({"law": "yeoh", "C10_kPa": 6.0}, Ogden((12e-3,), (2.0,))),
        ({"law": "gent", "mu_kPa": 12.0, "Jm": 1e9}, Ogden((12e-3,), (2.0,))),
        (
            {"mu_kPa": [10.0, 0.3, -1.0], "alpha": [1.3, 3.6, -2.0]},
            Ogden((10e-3, 0.3e-3, -1e-3), (1.3, 3.6, -2.0)),
        ),
    ],
)
def test_a_law_of_any_kind_goes_from_the_configuration_through_its_file_into_the_elements(
    law, same, tmp_path
):
    given = given_law("soft", Material(parameters=law).parameters)
    write_law(tmp_path / "law.json", given)
    read = read_law(tmp_path / "law.json").law
    assert type(read).__name__ == type(given.law).__name__
    # Ogden's form of the same law; 1e-6 for the limits Jm and the stopping rule
    assert_allclose(force(study(), LAWS | {"soft": read}), force(study(), LAWS | {"soft": same}), rtol=1e-6)


@pytest.mark.parametrize(
    "law", [specimens.GEL, NeoHooke(0.01), MooneyRivlin(0.01, 0.002), Yeoh(0.01, 1e-3, 1e-4), Gent(0.01, 5.0)]
)
def test_other_exponents_keep_the_modulus_and_stiffen_in_tension(law):
    faster = law.with_exponents(1.2)
    assert faster.shear_modulus == pytest.approx(law.shear_modulus, rel=1e-12)
    assert law.with_exponents(1.0) is law
    lam = np.array([2.0, 2**-0.5, 2**-0.5])
    stress = [(b := kind.principal_stress(lam))[0] - b[2] for kind in (law, faster)]
    assert stress[1] > 1.01 * stress[0]


def test_more_terms_make_yeohs_model_and_scaled_layers_scale_the_force():
    # More terms of the energy make yeohs model of neo hookes
    soft = LAWS | {"soft": NeoHooke(0.02)}
    corrected = with_keys(study(), material={"energy_correction": {"gel": {"c2": 0.4, "c3": -0.05}}})
    yeoh = Yeoh(0.01, 0.4 * 0.01, -0.05 * 0.01)
    assert_allclose(force(corrected, soft), force(study(), LAWS | {"soft": yeoh}), rtol=1e-7)
    nothing = with_keys(study(), material={"energy_correction": {"gel": {}}})
    assert (force(nothing, soft) == force(study(), soft)).all()
    with pytest.raises(ConfigError, match="not regions"):
        with_keys(study(), material={"energy_correction": {"jelly": {"c2": 0.4}}})

    # Scaling every layer scales the force. Exactly so under displacement control: physics.md; to the stopping rule
    # here
    scaled = with_keys(study(), material={"stiffness_factor": {"gel": 1.3, "skin": 1.3}})
    free = {"mechanics": {"friction": 0.0}}  # the elastic slip of friction is a constant of the algorithm
    scaled, plain = (study_from(merged(s.model_dump(mode="json"), free)) for s in (scaled, study()))
    assert_allclose(force(scaled), 1.3 * force(plain), rtol=1e-6)


def test_an_unstable_law_is_refused_before_anything_is_solved():
    falling = Yeoh(0.01, -0.006, 0.0)
    check_laws({"gel": falling}, {"gel": (0.8, 1.1)})  # stable as far as this press goes
    for stretches in ((0.5, 1.1), (0.8, 1.6)):  # either end is enough
        with pytest.raises(ConfigError, match=r"gel is unstable .* from stretch \d\.\d.* press less deep"):
            check_laws({"gel": falling}, {"gel": stretches})
    with pytest.raises(ConfigError, match="has no stress in extension from stretch"):
        check_laws({"gel": Gent(0.01, 0.1)}, {"gel": (0.5, 1.5)})
    with pytest.raises(ConfigError, match="unstable"):
        force(study(), LAWS | {"soft": Yeoh(0.01, -0.05, 0.0)})


def test_compressibility_is_by_region_and_poissons_ratio_says_the_same():
    by_ratio = with_keys(study(), material={"poissons_ratio": {"gel": 0.49, "skin": 0.4}})
    ratios = region_bulk(by_ratio.sensor, by_ratio.mechanics, ("gel", "skin", "wall"))
    assert ratios == {
        "gel": pytest.approx(149 / 3),
        "skin": pytest.approx(14 / 3),
        "wall": pytest.approx(14 / 3),
    }
    by_bulk = with_keys(study(), material={"bulk_to_shear": {"gel": ratios["gel"], "skin": ratios["skin"]}})
    assert_allclose(force(by_ratio), force(by_bulk), rtol=1e-12)
    with pytest.raises(ConfigError, match="give one"):
        with_keys(by_ratio, material={"bulk_to_shear": {"gel": 10.0}})


# ---------------------------------------------------------------------------------------------------- geometry
def test_a_thicker_or_graded_layer_moves_the_mesh():
    """3 mm of gel in three elements moved to 3.3 mm: the nodes of the sensor drawn with 3.3 mm, in three elements too."""
    even = {"mesh": {"near_mm": 1.0, "far_mm": 1.0}}
    nominal = with_keys(specimens.study(**even), geometry={"thickness": {"gel": {"change_mm": 0.3}}})
    layers = [layer.model_dump() for layer in nominal.sensor.layers]
    layers[0]["thickness_mm"] = 3.3
    drawn = specimens.study(sensor={"layers": layers}, **even)
    moved = moved_mesh(mesh_of(nominal), nominal.sensor, nominal.mechanics.effects)
    assert_allclose(moved.X, mesh_of(drawn).X, atol=1e-12)
    assert np.array_equal(moved.fixed, mesh_of(drawn).fixed)

    # A graded layer stands on a flat base under a plane top
    graded = with_keys(study(), geometry={"thickness": {"gel": {"gradient": [0.02, -0.01]}}})
    mesh = mesh_of(graded)
    moved = moved_mesh(mesh, graded.sensor, graded.mechanics.effects)
    plane = (moved.X[:, :2] - 8.0) @ [0.02, -0.01]
    top, base = np.isclose(mesh.X[:, 2], 0), np.isclose(mesh.X[:, 2], -4)
    interface = np.isclose(mesh.X[:, 2], -1)
    assert_allclose(moved.X[top, 2], plane[top], atol=1e-14)
    assert_allclose(moved.X[interface, 2], -1 + plane[interface], atol=1e-14)
    assert (moved.X[base, 2] == -4).all()
    assert_allclose(mesh.ties @ moved.X, moved.X, atol=1e-14)  # hanging nodes hang where they did
    with pytest.raises(ConfigError, match="leaves gel .* of its nominal"):
        force(with_keys(study(), geometry={"thickness": {"gel": {"change_mm": -2.8}}}))


def test_a_slab_of_the_gel_s_own_law_is_a_thicker_gel():
    """Neo-Hookean gel of 3 mm over 2 mm of the same as a slab, against 5 mm of gel; 1 %: the slab's elements are longer."""
    laws = LAWS | {"soft": NeoHooke(0.01)}
    even = {"near_mm": 1.0, "far_mm": 1.0, "growth": 0.02}
    sensor = {"wall_mm": 0.0}
    on_slab = with_keys(
        specimens.study(sensor=sensor, mesh=even),
        geometry={"base": {"thickness_mm": 2.0, "youngs_modulus_MPa": 0.03}},
    )
    layers = [layer.model_dump() for layer in on_slab.sensor.layers]
    layers[0]["thickness_mm"] = 5.0
    thick = specimens.study(sensor=sensor | {"layers": layers}, mesh=even)
    known = force(thick, laws)
    assert np.linalg.norm(force(on_slab, laws) - known) < 0.01 * np.linalg.norm(known)
    rigid = with_keys(on_slab, geometry={"base": {"thickness_mm": 2.0, "youngs_modulus_MPa": None}})
    stiff = with_keys(on_slab, geometry={"base": {"thickness_mm": 2.0, "youngs_modulus_MPa": 1e4}})
    assert_allclose(force(stiff, laws), force(rigid, laws), rtol=1e-3)
    plain = force(specimens.study(sensor=sensor, mesh=even), laws)
    assert_allclose(
        force(rigid, laws), plain, rtol=1e-6
    )  # the tolerance of forces: sums are rounded in another order
    slab = region_laws(on_slab.sensor, on_slab.mechanics.effects, ("gel", "skin", "base"), BY_LAYER)["base"]
    assert slab.mu == pytest.approx(0.01)


def test_a_uniform_prestretch_of_a_lone_free_layer_is_not_felt_but_a_held_one_pulls():
    """Stretched gel on its base starts from F = diag(lam, lam, lam^-2); by how much it pulls: test_effects_limits.py."""
    lam = 1.1
    stretched = with_keys(study(), geometry={"prestretch": {"gel": [lam, lam], "skin": [lam, lam]}})
    model = model_of(
        stretched.sensor,
        stretched.indenter,
        stretched.mechanics,
        BY_LAYER,
        Trajectory(*specimens.CENTRE, (0.1,), ("load",)),
    )
    F = model.body.deformation_gradient(np.zeros_like(model.mesh.X))
    gel = model.mesh.region == model.mesh.regions.index("gel")
    assert_allclose(F[gel], np.broadcast_to(np.diag([lam, lam, lam**-2]), F[gel].shape))
    cell = simulate_cell(stretched, LAWS, PlannedCell("c", *specimens.CENTRE, (0.2, 0.4)))
    assert cell.converged
    assert max(cell.attributes["force_balance"]) < 1e-6
    assert (np.diff(cell.arrays["total_force_N"][:, 2], prepend=0) < 0).all()


# -------------------------------------------------------------------------------------------- pose and machine
def test_where_and_how_deep_the_indenter_really_is():
    k = {"misregistration_mm": [0.3, -0.1], "yaw_deg": 90.0 / 2, "grid_scale": 0.01}
    moved = with_keys(study(), kinematics=k)
    x, y = real_place(moved.sensor, moved.mechanics.effects, 10.0, 8.0)
    assert (x, y) == pytest.approx((8 + 1.01 * 2**0.5 + 0.3, 8 + 1.01 * 2**0.5 - 0.1))
    # the same place commanded; the mesh is fine around another place, so to its error
    shifted = with_keys(study(), kinematics={"misregistration_mm": [0.2, 0.0]})
    there = PlannedCell("b", specimens.CORNER[0] + 0.2, specimens.CORNER[1], (0.4,))
    assert force(shifted)[2] == pytest.approx(force(study(), planned=there)[2], rel=0.03)

    # Contact zero is depth
    deeper = with_keys(study(), kinematics={"contact_zero_mm": 0.05})
    planned = PlannedCell("a", *specimens.CORNER, (0.35,))
    # the same pose reached in one step on the same mesh: only what the fine region's size does differs
    assert_allclose(force(deeper, planned=planned), force(study()), rtol=1e-6)

    # Depth from one touch is that of the tilted or thicker gel
    tilted = with_keys(study(), kinematics={"tilt_deg": [2.0, -1.0], "zero_by": "session"})
    effects, ball = tilted.mechanics.effects, Sphere(5.0)
    start, lead = plane_touch(tilted.sensor, effects, ball, 10.0, 9.0)
    assert start[2] == pytest.approx(5.0, abs=1e-12)  # a ball of 5 mm on z = 0, whatever its path
    _, none = plane_touch(tilted.sensor, effects, ball, 8.0, 8.0)
    assert none == pytest.approx(0, abs=1e-12)
    # Turned by 2 deg about x the side of larger y comes up by sin(2 deg) 1 mm, by -1 deg about y that of larger x by
    # sin(1 deg) 2 mm, to first order: the ball meets it sooner and goes so much deeper
    assert lead == pytest.approx(np.sin(np.radians(2)) * 1 + np.sin(np.radians(1)) * 2, rel=2e-3)
    by_press = with_keys(tilted, kinematics={"zero_by": "press"}).mechanics.effects
    assert plane_touch(tilted.sensor, by_press, ball, 10.0, 9.0)[1] == 0

    # Depth from one touch is more where the gel is thicker
    wedge = {"thickness": {"gel": {"gradient": [0.02, -0.01]}}}
    graded = with_keys(study(), geometry=wedge, kinematics={"zero_by": "session"})
    _, lead = plane_touch(graded.sensor, graded.mechanics.effects, Sphere(5.0), 10.0, 7.0)
    assert lead == pytest.approx(0.02 * 2 + 0.01 * 1, abs=1e-12)  # so much nearer is the top of a plane wedge


@pytest.mark.parametrize("turn_deg", [1.5, -3.0])
def test_depth_from_one_touch_is_as_deep_as_the_turned_top_lets_it_be(turn_deg):
    """A ball sent by d, 0 where it touches the middle, along the machine's axis: its centre is R + x sin - d cos above."""
    tilted = with_keys(study(), kinematics={"tilt_deg": [0.0, turn_deg], "zero_by": "session"})
    x, d, a = 2.5, 0.7, np.radians(turn_deg)
    start, lead = plane_touch(tilted.sensor, tilted.mechanics.effects, Sphere(5.0), 8.0 + x, 8.0)
    along = np.array([np.sin(a), 0.0, -np.cos(a)])  # of the machine's way down, in the sensor's axes
    assert (start + (d + lead) * along)[2] == pytest.approx(5.0 + x * np.sin(a) - d * np.cos(a), abs=1e-12)


def test_tilting_is_pressing_obliquely():
    """Frictionless, the ball only feels where it ends: 0.4 mm at 10 degrees are 0.4 cos down and 0.4 sin aside."""
    tilt = 10.0
    tilted = with_keys(study(friction=0.0), kinematics={"tilt_deg": [0.0, tilt]})
    turned = force(tilted)
    a = np.radians(tilt)
    x, y = specimens.CORNER
    model = model_of(
        tilted.sensor, tilted.indenter, tilted.mechanics, BY_LAYER, Trajectory(x, y, (0.4,), ("load",))
    )
    assert_allclose(np.abs(model.centres[0] - model.start), [0.4 * np.sin(a), 0, 0.4 * np.cos(a)], atol=1e-12)
    # Turned about +y the sensor's x axis points down, so a vertical path runs towards it.
    assert model.centres[0, 0] > model.start[0]
    moved = {"misregistration_mm": [float(model.centres[0, 0]) - x, 0.0]}
    upright = with_keys(study(friction=0.0), kinematics=moved)  # on the same mesh
    same = force(upright, planned=PlannedCell("p", x, y, (0.4 * np.cos(a),)))
    assert_allclose(turned, same, rtol=1e-6, atol=1e-9)


def test_a_frame_and_a_base_plate_yield_with_the_force():
    c = 0.1
    soft = with_keys(study(), kinematics={"frame_compliance_mm_per_N": c})
    cell = simulate_cell(soft, LAWS, PlannedCell("a", *specimens.CORNER, (0.4, 0.8)))
    centre, Fz = cell.arrays["indenter_mm"][:, 2], cell.arrays["total_force_N"][:, 2]
    assert_allclose(5.0 - centre, np.array([0.4, 0.8]) + c * Fz, atol=1e-9)
    reached = PlannedCell("b", *specimens.CORNER, tuple(5.0 - centre))
    at_depth = simulate_cell(study(), LAWS, reached).arrays["total_force_N"]
    # The plain press at the depths reached. The path of friction stops on the way at other depths, which changes the shear.
    error = np.linalg.norm(cell.arrays["total_force_N"] - at_depth, axis=1)
    assert (error < 5e-4 * np.linalg.norm(at_depth, axis=1)).all()

    # A base plate yields most in its middle
    bent = with_keys(study(), kinematics={"base_bending_mm_per_N": 0.1})
    effects = bent.mechanics.effects
    assert_allclose(yielding(bent.sensor, effects, 8.0, 8.0), [0, 0, -0.1], atol=1e-15)
    assert_allclose(yielding(bent.sensor, effects, 4.0, 8.0), [0, 0, -0.05], atol=1e-15)
    assert np.linalg.norm(yielding(bent.sensor, effects, 16.0, 8.0)) < 1e-15


# --------------------------------------------------------------------------------------- catalogue and refusals
def test_the_catalogue_says_what_a_reader_needs_and_which_effects_mirror():
    # The catalogue says what a reader needs and adds to a study
    families = {"material", "history", "contact", "geometry", "kinematics"}
    for name, effect in CATALOGUE.items():
        assert effect.name == name and effect.family in families
        assert effect.parameter and effect.unit and effect.width > 0
    with pytest.raises(ValueError, match="on .1. or off .0."):
        CATALOGUE["frictionless"](study(), 0.5)

    # An effect is added to what the study has
    both = CATALOGUE["void"](CATALOGUE["inclusion"](study(), 0.6), 0.5, Place(5.0, 5.0, -2.0, 0.8))
    found = [i.factor for i in both.mechanics.effects.geometry.inclusions]
    assert found == [
        pytest.approx(4.75),
        pytest.approx(0.375),
    ]  # of 2.5 for a rigid ball, of -5/3 for an empty one
    twice = CATALOGUE["gel_stiffness"](CATALOGUE["gel_stiffness"](study(), 0.1), 0.1)
    assert twice.mechanics.effects.material.stiffness_factor == {"gel": pytest.approx(1.21)}

    # Mirrored cells need effects that mirror
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [0.4], "symmetry": "d4"}
    square = specimens.study(plan=plan)
    with_keys(square, material={"stiffness_factor": {"gel": 1.1}})
    for families in (
        {"kinematics": {"tilt_deg": [1.0, 0.0]}},
        {"geometry": {"thickness": {"gel": {"gradient": [0.01, 0.0]}}}},
        {"geometry": {"inclusions": [{"centre_mm": [5, 5, -2], "radius_mm": 1.0}]}},
        {"history": {"mullins": {"gel": {"amount": 0.2}}}},
    ):
        with pytest.raises(ConfigError, match="plan.symmetry: d4 .* use symmetry: auto"):
            with_keys(square, **families)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"effects": {"material": {"stiffness_factor": {"glue": 2.0}}}}, ["glue", "are not regions", "gel"]),
        ({"effects": {"history": {"mullins": {"base": {}}}}}, ["base", "are not regions"]),
        ({"effects": {"geometry": {"wall_gap": {"loss": 1.5}}}}, ["wall_gap.loss", "1.5"]),
        (
            {
                "effects": {
                    "history": {"viscoelastic": {"gel": {"relative_moduli": [0.1], "times_s": [1, 2]}}}
                }
            },
            ["pairs"],
        ),
        ({"strain": "small", "effects": {"history": {"mullins": {"gel": {}}}}}, ["strain: finite"]),
        ({"effects": {"kinematics": {"tilt": 1.0}}}, ["tilt", "unknown key"]),
        ({"effects": {"geometry": {"prestretch": {"gel": [0.0, 1.0]}}}}, ["stretch <= 0"]),
    ],
)
def test_effects_that_cannot_be_are_refused(change, words):
    with pytest.raises(ConfigError) as refused:
        study_from(merged(study().model_dump(mode="json"), {"mechanics": change}))
    for word in words:
        assert word in str(refused.value)
