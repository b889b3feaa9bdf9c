"""Convolutional networks of any grids, and their keys in a study."""

import shutil
from pathlib import Path

import pytest
import torch
from pydantic import ValidationError

from gelforge.config import Learning
from gelforge.learning import networks
from gelforge.learning.basis.network import Grids
from gelforge.learning.networks import make_network, network_of
from gelforge.registry import stated


@pytest.mark.parametrize("name", ["unet", "unet_inverse", "cnn"])
@pytest.mark.parametrize(
    "grids", [Grids(40, 20, 20), Grids(10, 20, 20), Grids(7, 5, 3), Grids(3, 1, 1), Grids(13, 12, 6)]
)
def test_any_grid_of_regions_becomes_any_grid_of_bins(name, grids):
    network = make_network(Learning(network=name, channels=4), grids, seed=1)
    more = 3 * grids.bins_x * grids.bins_y if network_of(name).reads_inverse else 0
    outputs = network(torch.randn(2, 2 * grids.regions**2 + more))
    assert outputs.shape == (2, 3 * grids.bins_x * grids.bins_y)
    outputs.sum().backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.parameters())


@pytest.mark.parametrize("name", ["unet", "unet_inverse", "cnn", "paper"])
def test_seeds_make_networks(name):
    def weights(seed):
        network = make_network(Learning(network=name), Grids(4, 2, 2), seed)
        return torch.cat([p.flatten() for p in network.parameters()])

    assert torch.equal(weights(1), weights(1))
    assert not torch.equal(weights(1), weights(2))


def test_a_unet_keeps_places_and_passes_the_inverse_on():
    # A unet keeps places. What moves next to the left side of the image loads bins there first: x of regions is x
    # of bins, and so is y
    network = make_network(Learning(), Grids(40, 20, 20), seed=0)
    torch.nn.init.ones_(network.last.weight)
    maps = torch.zeros(1, 2, 40, 40)
    maps[0, :, 30:32, 4:6] = 1.0
    with torch.inference_mode():
        nothing, something = network(torch.zeros(1, 3200)), network(maps.reshape(1, -1))
    change = (something - nothing).reshape(20, 20, 3).norm(dim=-1)
    row, column = divmod(int(change.argmax()), 20)
    assert abs(row - 15) <= 3
    assert abs(column - 2) <= 3

    # An untrained unet passes the inverse on. Forces of the inverse reach their bins times the factor of their
    # component
    network = make_network(Learning(network="unet_inverse", channels=4), Grids(8, 5, 3), seed=0)
    with torch.no_grad():
        network.skip.copy_(torch.tensor([1.0, 2.0, 3.0]))
        forces = torch.randn(2, 45)
        found = network(torch.cat([torch.randn(2, 128), forces], dim=1))
    torch.testing.assert_close(found.reshape(2, 15, 3), forces.reshape(2, 15, 3) * network.skip)


@pytest.mark.parametrize("name", ["unet", "unet_inverse", "cnn"])
def test_the_signal_keeps_its_size_up_to_the_last_layer_which_is_zero(name):
    """PyTorch's own start leaves some 2 per cent of it."""
    network = make_network(Learning(network=name), Grids(40, 20, 20), seed=0)
    arriving = []
    network.last.register_forward_hook(lambda layer, inputs, outputs: arriving.append(inputs[0]))
    flow = torch.randn(8, 3200, generator=torch.Generator().manual_seed(0))
    forces = torch.zeros(8, 1200 if network_of(name).reads_inverse else 0)
    with torch.inference_mode():
        outputs = network(torch.cat([flow, forces], dim=1))
    assert 0.1 < float(arriving[0].square().mean().sqrt()) < 1
    assert not outputs.any()


def test_keys_belong_to_a_network_as_in_the_guides_example(tmp_path, monkeypatch):
    # Keys belong to a network and have usual values
    with pytest.raises(
        ValidationError, match=r"hidden is a key of network paper, found network unet; .*set network: paper"
    ):
        Learning(network="unet", hidden=[10])
    with pytest.raises(
        ValidationError,
        match="channels is a key of network cnn and unet and unet_inverse, found network paper",
    ):
        Learning(network="paper", channels=8)

    # What is left open is usual for the network
    assert Learning(network="paper").usual.steps == 54_000
    assert Learning(network="paper").usual.batch_size == 400
    assert Learning(network="paper", steps=3).usual.steps == 3
    assert Learning().usual.learning_rate == 3e-3
    assert Learning.model_validate(Learning(network="paper", hidden=[9]).model_dump()).hidden == [9]

    # A study that gives widths of layers means the papers network
    assert Learning(hidden=[32, 16], steps=5).network == "paper"
    assert Learning(input_form="vector").usual.steps == 54_000
    assert Learning(steps=5).network == "unet"

    # The guides example is a network
    file = Path(shutil.copy("docs/adding/examples/linear.py", tmp_path))
    monkeypatch.setattr(networks, "__path__", [*networks.__path__, str(tmp_path)])
    network = network_of("linear").make(Learning(), Grids(7, 5, 3), 1)
    assert network(torch.randn(2, 98)).shape == (2, 45)
    about = stated(file, "KEYS", "USUAL")
    assert about == {"KEYS": ("symmetry",), "USUAL": {"learning_rate": 1e-3, "batch_size": 32, "steps": 2000}}
    with pytest.raises(TypeError, match=r"linear.py states no WORDS"):
        stated(file, "KEYS", "WORDS")
