"""Image features, shards and splits, and the network."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gelforge.config.common import NonNegative, Positive, Section


class Features(Section):
    """Optical-flow features of an image."""

    regions: int = Field(40, ge=1, le=200, description="image regions along each side; m = regions^2 [-]")
    flow_preset: Literal["ultrafast", "fast", "fine", "medium"] = Field(
        "fine",
        description="preset of Dense Inverse Search; fine: fast, but at half resolution without smoothing",
    )
    moved_px: NonNegative = Field(
        0.05, description="pixels that moved less do not vote on the direction [px]"
    )


class Dataset(Section):
    """How rows become shards and splits."""

    test_fraction: float = Field(0.2, gt=0, lt=1, description="share of cells held out for testing [-]")
    cells_per_shard: int = Field(16, ge=1, description="cells in one shard file [-]")


class Learning(Section):
    """The network of Sferrazza et al. 2019, table 2, and how it is trained."""

    input_form: Literal["vector", "polar"] = Field(
        "polar",
        description="feed each region's magnitude and direction (polar) or the flow's components (vector)",
    )
    hidden: list[Annotated[int, Field(ge=1)]] = Field(
        [800, 600, 400], description="widths of the hidden layers [-]"
    )
    dropout: float = Field(0.1, ge=0, lt=1, description="dropout after each hidden layer [-]")
    learning_rate: Positive = Field(1e-4, description="Adam's step size [-]")
    batch_size: int = Field(400, ge=1, description="rows per step [-]")
    epochs: int = Field(400, ge=1, description="passes over the training rows [-]")
    validation_fraction: float = Field(
        0.1, gt=0, lt=1, description="share of training cells that watch the loss [-]"
    )
