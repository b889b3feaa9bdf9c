"""How deep an indenter really goes, and how far a law must be stable for it: found before anything is solved."""

import numpy as np
import pytest
import specimens
from numpy.testing import assert_allclose

from gelforge.config import ConfigError, Variant
from gelforge.indentation.effects.material import stretches_ahead
from gelforge.indentation.paths.first_contact import surface_point
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.plan import check_inside, plan_cells, variant_cells
from gelforge.indentation.planning.reach import planned_reach
from gelforge.indentation.solving import model
from gelforge.indentation.solving.model import model_of
from gelforge.indentation.solving.simulate import simulate_cell
from gelforge.mechanics.indenters.shapes import Sphere
from gelforge.mechanics.laws.models.yeoh import Yeoh

LAWS = specimens.STUDY_LAWS
BY_LAYER = {"gel": specimens.GEL, "skin": specimens.SKIN}
TILTED_BACK = {"tilt_deg": [0.0, -6.0], "zero_by": "session"}
BOX = {"kind": "box", "size_mm": [6.0, 6.0, 8.0]}


def effects(**families):
    return {"effects": families}


# --------------------------------------------------------------------------------------------------- piercing
@pytest.mark.parametrize(
    ("depth", "mechanics", "words"),
    [
        (
            0.8,
            effects(kinematics={"contact_zero_mm": 3.0}),
            r"site x0_y0: depth 3\.8 mm \(commanded: 0\.8 mm\) would pierce .* 0\.6 of their height 4\.0 mm there"
            r" \(2\.4 mm\); press less deep, or correct contact_zero_mm",
        ),
        (1.8, effects(geometry={"thickness": {"gel": {"change_mm": -1.2}}}), r"height 2\.8 mm there \(1\.68"),
        # thinner by 0.1 x 3 mm at the first position, thick enough in the middle
        (
            2.3,
            effects(geometry={"thickness": {"gel": {"gradient": [0.1, 0.0]}}}),
            r"x0_y0: .* height 3\.7 mm",
        ),
        # the side of larger x stands nearer by 3 mm sin 6 deg, where the depth counts from the middle
        (2.2, effects(kinematics=TILTED_BACK), r"site x[02]_y0: depth 2\.5\d* mm \(commanded: 2\.2 mm\)"),
    ],
    ids=["zero", "thinner", "graded", "session"],
)
def test_a_plan_is_refused_for_the_depth_that_is_really_reached(depth, mechanics, words):
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [depth]}
    plan_cells(specimens.study(plan))  # as drawn it is no trouble
    study = specimens.study(plan, **mechanics)
    with pytest.raises(ConfigError, match=words):
        plan_cells(study)
    by_itself = [Trajectory(x, 5.0, (depth,), ("load",)) for x in (5.0, 11.0)]
    with pytest.raises(ConfigError, match="would pierce"):  # whoever makes models is told too
        [model_of(study.sensor, study.indenter, study.mechanics, BY_LAYER, path) for path in by_itself]


def test_turned_indenters_reach_deeper_and_a_dome_is_as_thick_as_there():
    # A turn of the indenter sinks its edge. An edge 3 mm from the axis, rounded by 0.5 mm, sinks by 2.5 mm sin a +
    # 0.5 mm (1 - cos a)
    study = specimens.study(indenter=BOX)
    turned = PlannedCell("a", 8.0, 8.0, (2.0,), phases=("tilt",), tilts_deg=((0.0, 15.0),))
    a = np.radians(15.0)
    shape = model.shape_of(study.indenter)
    found = planned_reach(study.sensor, study.mechanics.effects, shape, Trajectory.of(turned))
    assert found.depth_mm == pytest.approx(2.0 + 2.5 * np.sin(a) + 0.5 * (1 - np.cos(a)), abs=1e-9)
    with pytest.raises(ConfigError, match=r"depth 2\.664 mm \(commanded: 2 mm\) would pierce"):
        check_inside({"a": turned}, study)

    # A dome is as thick as it is under the press. A half-ellipsoid 4 mm high, 8 mm wide to each side: at 6 mm from
    # the middle 4 sqrt(1 - 0.75^2) = 2.65 mm are left
    mesh = {"near_mm": 0.8, "near_radius_mm": 1.5, "growth": 0.3, "far_mm": 1.6}
    study = specimens.study(sensor={"shape": {"kind": "dome"}, "wall_mm": 0.0}, mesh=mesh, error_bars=False)
    deep = PlannedCell("a", 14.0, 8.0, (2.3,))
    check_inside({"a": deep}, study)  # a plan knows the highest point only
    with pytest.raises(ConfigError, match=r"at \(14, 8\) mm: depth .* of their height 2\.6\d* mm there"):
        simulate_cell(study, LAWS, deep)


def test_a_smaller_ball_and_a_variant_are_checked_too():
    plan = {"grid": {"spacing_mm": 3.0, "margin_mm": 5.0}, "depths_mm": [1.2]}
    smaller = effects(geometry={"indenter_radius_change_mm": -1.0})
    plan_cells(specimens.study(plan, indenter={"radius_mm": 2.0}))
    with pytest.raises(ConfigError, match=r"1\.2 mm is beyond the widest part .* 1 mm above"):
        plan_cells(specimens.study(plan, indenter={"radius_mm": 2.0}, **smaller))

    # A variant that would pierce is refused with the plan
    study = specimens.study()
    deeper = Variant(cells=["x1_y1"], mechanics=effects(kinematics={"contact_zero_mm": 2.0}))
    study = study.model_copy(update={"variants": {"deeper": deeper}})
    with pytest.raises(ConfigError, match=r"site x1_y1: depth 2\.8 mm \(commanded: 0\.8 mm\)"):
        variant_cells(plan_cells(study), study, "deeper")


@pytest.mark.parametrize(
    "families",
    [
        {},
        {"kinematics": {"contact_zero_mm": 0.3}},
        {"kinematics": {"tilt_deg": [2.0, -1.0], "zero_by": "session", "misregistration_mm": [0.5, 0.0]}},
        {
            "geometry": {
                "thickness": {
                    "gel": {"change_mm": -0.4, "gradient": [0.05, 0.02]},
                    "skin": {"change_mm": 0.1},
                }
            },
            "kinematics": {"zero_by": "session"},
        },
        {"geometry": {"indenter_radius_change_mm": 0.5}},
    ],
    ids=["plain", "zero", "tilt", "thickness", "radius"],
)
def test_what_a_plan_foresees_is_where_the_model_goes(families):
    """Against the model's own mesh: the ball's lowest point under the top over its centre, and the height of that top."""
    study = specimens.study(**effects(**families))
    path = Trajectory(10.9, 10.3, (0.4, 0.8), ("load", "load"))
    ball = Sphere(5.0 + families.get("geometry", {}).get("indenter_radius_change_mm", 0.0))
    found = planned_reach(study.sensor, study.mechanics.effects, ball, path)
    model = model_of(study.sensor, study.indenter, study.mechanics, BY_LAYER, path)
    x, y, z = model.centres[-1]
    top = surface_point(model.mesh, x, y)[0][2]
    assert found.depth_mm == pytest.approx(top - (z - ball.radius), abs=1e-9)
    assert found.height_mm == pytest.approx(top - model.mesh.X[:, 2].min(), abs=1e-9)


# ----------------------------------------------------------------------------------------------- stable laws
@pytest.mark.parametrize(
    ("depth", "keys"),
    [
        (1.6, {}),
        (0.5, {"mechanics": effects(kinematics={"contact_zero_mm": 1.1})}),
        (0.4, {"mechanics": effects(geometry={"prestretch": {"skin": [1.1, 1.1]}})}),
        (1.4, {"indenter": {"radius_mm": 2.0}}),
        (1.6, {"indenter": {"radius_mm": 8.0}}),
        (1.2, {"indenter": {"kind": "cylinder", "radius_mm": 3.0}}),
        (1.4, {"sensor": {"layers": [{"name": "gel", "thickness_mm": 4.0, "material": "soft"}]}}),
    ],
    ids=["ball", "zero", "prestretch", "small ball", "large ball", "cylinder", "one layer"],
)
def test_the_stretches_foreseen_enclose_those_that_are_reached(depth, keys):
    study = specimens.study(
        sensor=keys.get("sensor"),
        indenter=keys.get("indenter"),
        error_bars=False,
        **keys.get("mechanics", {}),
    )
    seen = {}

    def remembering(laws, stretches):
        seen.update(stretches)

    planned = PlannedCell("a", *specimens.CORNER, (depth,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(model, "check_laws", remembering)
        cell = simulate_cell(study, LAWS, planned)
    assert cell.converged, cell.attributes["reason"]
    for name, (low, high) in zip(cell.attributes["regions"], cell.attributes["stretch_range"][-1]):
        smallest, largest = seen[name]
        assert smallest < low and high < largest, name
    assert not cell.attributes["law_unstable"].any()


def test_soft_layers_among_stiff_ones_are_strained_most():
    """Pressed together by a tenth, a layer of h / H = 1/4 that gives way alone is pressed by four tenths."""
    layers = [("under", 1.5, "stiff"), ("gel", 1.0, "soft"), ("skin", 1.5, "stiff")]
    keys = [{"name": name, "thickness_mm": h, "material": material} for name, h, material in layers]
    study = specimens.study(sensor={"layers": keys})
    laws = {"under": specimens.SKIN, "gel": specimens.GEL, "skin": specimens.SKIN}
    found = stretches_ahead(
        study.sensor, study.mechanics.effects, laws, ("under", "gel", "skin", "wall"), 0.1
    )
    assert found["under"] == found["skin"] == found["wall"]
    strain = {name: np.log(high) for name, (_, high) in found.items()}
    ratio = specimens.GEL.shear_modulus / specimens.SKIN.shear_modulus
    assert strain["gel"] / strain["skin"] == pytest.approx(4 / (1 + 3 * ratio), rel=1e-12)
    none = stretches_ahead(study.sensor, study.mechanics.effects, laws, ("gel",), -0.1)
    assert_allclose(none["gel"], 1.0)  # a press that does not touch


def test_a_law_that_proves_unstable_is_flagged_in_the_cell(monkeypatch):
    monkeypatch.setattr(
        model, "check_laws", lambda laws, stretches: None
    )  # as if the estimate were too small
    falling = Yeoh(0.0035, -0.002, 4.5e-4)  # it rises again, so the press converges
    cell = simulate_cell(
        specimens.study(error_bars=False),
        LAWS | {"soft": falling},
        PlannedCell("a", *specimens.CORNER, (0.1, 1.6)),
    )
    assert cell.converged, cell.attributes["reason"]
    assert cell.attributes["law_unstable"].tolist() == [0, 1]
    gel = list(cell.attributes["regions"]).index("gel")
    assert 0 < cell.attributes["volume_law_unstable"][1, gel] < 1
