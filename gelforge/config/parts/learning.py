"""Image features, shards and splits, and the network."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from gelforge.registry import names_in, stated
from gelforge.section import GrownSection, NonNegative, Positive, Section


class Features(GrownSection):
    """Optical-flow features of an image."""

    later = ("image_scale",)
    regions: int = Field(40, ge=1, le=200, description="image regions along each side; m = regions^2 [-]")
    flow_preset: Literal["ultrafast", "fast", "fine", "full", "medium"] = Field(
        "fine",
        description="preset of Dense Inverse Search; fine: fast, but at half resolution without smoothing; full: fine at "
        "full resolution, which for images reduced to half is the flow of fine in less time",
    )
    moved_px: NonNegative = Field(
        0.05, description="pixels that moved less do not vote on the direction [px]"
    )
    image_scale: float = Field(
        1.0,
        gt=0,
        le=1,
        description="images are reduced to this share of their width and height before the search; flow stays in pixels "
        "of the image before [-]",
    )


class Dataset(Section):
    """How rows become shards and splits."""

    test_fraction: float = Field(0.2, gt=0, lt=1, description="share of sites held out for testing [-]")
    cells_per_shard: int = Field(16, ge=1, description="sites in one shard file [-]")


# What the files of networks state of themselves; they are read and not imported: PyTorch takes seconds and stands above.
FOLDER = Path(__file__).parents[2] / "learning" / "networks"
NETWORKS = {name: stated(FOLDER / f"{name}.py", "KEYS", "USUAL") for name in names_in([str(FOLDER)])}
if TYPE_CHECKING:
    NetworkName = str  # a type checker cannot read the folder
else:
    NetworkName = Literal[tuple(NETWORKS)]


def networks_of(key: str) -> list[str]:
    """Return the networks to which a key means something, where it does not to all."""
    return [name for name, network in NETWORKS.items() if key in network["KEYS"]]


class Learning(Section):
    """The network and how it is trained."""

    network: NetworkName = Field(
        "unet",
        description="unet: flow components on the grid of regions to forces on the grid of bins; unet_inverse: that with"
        " the forces of inverse elasticity as inputs too; cnn: a few convolutions alone in place of the U-Net; paper: the"
        " layers of Sferrazza et al. 2019, table 2",
    )
    channels: int = Field(
        16, ge=4, le=256, description="channels on the finest grid (unet, unet_inverse, cnn) [-]"
    )
    symmetry: Literal["auto", "d4", "none"] = Field(
        "auto",
        description="turn and mirror images with their labels while training (unet, unet_inverse, cnn); auto: where sensor"
        " and camera are their own mirror images and the plan has none of its sites",
    )
    input_form: Literal["vector", "polar"] = Field(
        "polar",
        description="feed each region's magnitude and direction (polar) or the flow's components (vector) (paper)",
    )
    hidden: list[Annotated[int, Field(ge=1)]] = Field(
        [800, 600, 400], description="widths of the hidden layers (paper) [-]"
    )
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout after each hidden layer (paper) [-]")
    learning_rate: Positive | None = Field(
        None, description="largest step size; null: the network's usual one (docs/learning.md) [-]"
    )
    batch_size: int | None = Field(
        None, ge=1, description="rows per step; null: the network's usual number (docs/learning.md) [-]"
    )
    steps: int | None = Field(
        None,
        ge=1,
        description="optimiser steps, each of a batch; null: the network's usual number (docs/learning.md) [-]",
    )
    validation_fraction: float = Field(
        0.1, gt=0, lt=1, description="share of training orbits on which the loss is monitored [-]"
    )

    onnx: bool = Field(
        False,
        description="export the trained model to ONNX and compare ONNX Runtime with PyTorch on held-out images; needs the "
        "extra `export`",
    )

    @model_validator(mode="before")
    @classmethod
    def _named_by_its_keys(cls, given):
        """A study from before networks had names means the article's where it says how wide its layers are."""
        keys = [key for key in cls.model_fields if networks_of(key) == ["paper"]]
        if isinstance(given, dict) and "network" not in given and any(key in given for key in keys):
            return {"network": "paper", **given}
        return given

    @model_validator(mode="after")
    def _belongs_to_the_network(self) -> Learning:
        for key in sorted(self.model_fields_set):
            networks = networks_of(key)
            given = getattr(self, key) != type(self).model_fields[key].default
            if networks and self.network not in networks and given:
                raise ValueError(
                    f"{key} is a key of network {' and '.join(networks)}, found network {self.network}; "
                    f"leave it out or set network: {networks[0]}"
                )
        return self

    @property
    def form(self) -> str:
        """How flow is fed to the network."""
        return self.input_form if self.network in networks_of("input_form") else "vector"

    @property
    def usual(self) -> CompleteLearning:
        """These settings with what is not given as usual for the network."""
        usual = NETWORKS[self.network]["USUAL"]
        chosen = {name: getattr(self, name) or value for name, value in usual.items()}
        return CompleteLearning.model_construct(self.model_fields_set | set(chosen), **(dict(self) | chosen))


class CompleteLearning(Learning):
    """The same with nothing left open; made by Learning.usual."""

    learning_rate: Positive
    batch_size: int
    steps: int
