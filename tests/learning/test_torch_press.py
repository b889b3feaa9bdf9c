"""A press as a function of PyTorch: gradients next to central differences of the finite elements, and what has none."""

import pytest
import torch
from specimens import ONE_LAYER

import gelforge as gf
from gelforge.config import ConfigError

TWO_STEPS = ONE_LAYER | {"steps": 2}
PLACE = (4.3, 5.2)


def test_gradients_are_those_of_central_differences():
    depth = torch.tensor(0.7, dtype=torch.float64, requires_grad=True)
    effects = {
        name: torch.tensor(amount, dtype=torch.float32, requires_grad=True)
        for name, amount in (("gel_stiffness", 0.1), ("friction", -0.05))
    }
    found = gf.torch_press(*PLACE, depth, effects, **TWO_STEPS)
    assert found.total_N.shape == (2, 3) and found.bins_N.shape == (2, 24, 3)
    weight = torch.linspace(-1, 1, 24, dtype=torch.float64)
    # the total, and something of all bins at both steps
    loss = found.total_N[-1, 2] + (found.bins_N * weight[:, None]).sum()
    loss.backward()

    def at(depth, **amounts):
        answer = gf.press_slopes(
            *PLACE, depth, {"gel_stiffness": 0.1, "friction": -0.05} | amounts, along=[], **TWO_STEPS
        )
        assert not answer.total_slope
        return answer.total_force_N[-1, 2] + (answer.bin_force_N * weight.numpy()[:, None]).sum()

    def difference(step, of):
        return (of(step) - of(-step)) / (2 * step)

    expected = {
        "depth": difference(2e-3, lambda d: at(0.7 + d)),
        "gel_stiffness": difference(1e-2, lambda d: at(0.7, gel_stiffness=0.1 + d)),
        "friction": difference(1e-2, lambda d: at(0.7, friction=-0.05 + d)),
    }
    gradients = {"depth": depth.grad} | {name: tensor.grad for name, tensor in effects.items()}
    assert effects["friction"].grad.dtype == torch.float32
    for name, wanted in expected.items():
        assert gradients[name].item() == pytest.approx(wanted, rel=0.02), name


def test_gradients_along_the_place_and_effects_are_those_of_one_mesh():
    # Gradients along the place are those of a shift of all positions. tests/indentation/test_carried_place.py
    # compares that one with differences; along y it is the mirrored press's
    place = [torch.tensor(value, dtype=torch.float64, requires_grad=True) for value in PLACE]
    gf.torch_press(*place, 0.7, **TWO_STEPS).total_N[-1, 0].backward()
    shifted = gf.press(*PLACE, [0.35, 0.7], **ONE_LAYER, sensitivities=["misregistration"])
    assert place[0].grad.item() == pytest.approx(shifted.slopes["misregistration"].total[-1, 0], rel=1e-3)
    mirrored = gf.press_slopes(*PLACE[::-1], 0.7, along=["y_mm"], **TWO_STEPS)
    assert mirrored.total_slope["y_mm"][-1, 1] == pytest.approx(place[0].grad.item(), rel=1e-6)
    assert abs(place[1].grad.item()) < 0.5 * abs(place[0].grad.item())

    # Derivatives are those of one mesh and one path
    with pytest.raises(ConfigError, match=r"along: \['friction'\]; choose among .* effects need a value"):
        gf.press_slopes(6.0, 6.0, 0.5, along=["friction"], **TWO_STEPS)

    # Effects that have derivatives are those of one mesh and one path
    from gelforge.api.differentiable import effects_with_slopes

    names = set(effects_with_slopes())
    assert {"gel_stiffness", "friction", "indenter_radius", "tilt", "layer_thickness"} <= names
    assert not {"mullins", "viscoelastic", "elastic_base", "small_strain", "frame_compliance"} & names


@pytest.mark.parametrize(
    ("at", "keys", "words"),
    [
        (
            (6.0, 6.0, 0.5, {"mullins": 0.1}),
            {},
            r"effects: \['mullins'\] have no derivative .*'gel_stiffness'",
        ),
        ((6.0, 6.0, 0.5, {"gelstiffness": 0.1}), {}, "choose among"),
        ((6.0, 6.0, -0.5), {}, "depth_mm=-0.5: a depth above 0"),
        ((torch.zeros(3), 6.0, 0.5), {}, r"x_mm: a tensor of shape \(3,\); one number is needed, call once"),
        (
            (6.0, 6.0, 0.5),
            {"mechanics": {"mesh": {"elements": "tetrahedra"}}},
            "on a block meshed by hexahedra only",
        ),
        (
            (6.0, 6.0, 0.5),
            {"mechanics": {"effects": {"kinematics": {"frame_compliance_mm_per_N": 0.1}}}},
            "compliance of the machine.*leave them out",
        ),
    ],
)
def test_what_has_no_derivative_is_refused_with_a_remedy(at, keys, words):
    x, *rest = at
    x = x if torch.is_tensor(x) else torch.tensor(x, requires_grad=True)
    with pytest.raises(ConfigError, match=words):
        gf.torch_press(x, *rest, **TWO_STEPS | keys)
