"""Patterns of both channels: those of the forces and those of the flow, each nothing on the other."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from gelforge.mismatch.goodness.scan import Atoms, dictionary

FLOW_AXES = {
    "force along x": "flow along u",
    "force along y": "flow along v",
    "share of the force": "share of the flow",
}


def patterns(labels: pd.DataFrame, base: np.ndarray) -> Atoms:
    """Return the atoms of readings with these labels (n rows) and base (n,), channel by channel where they name one."""
    if "channel" not in labels:
        return dictionary(labels, base)
    names: list[str] = []
    kinds: list[str] = []
    regions: list[Mapping] = []
    values = []
    for channel, rows in labels.groupby("channel", sort=False).indices.items():
        own = dictionary(labels.iloc[rows].reset_index(drop=True), base[rows])
        whole = np.zeros((len(labels), own.values.shape[1]))
        whole[rows] = own.values
        values.append(whole)
        kinds += own.kinds
        if channel == "force":
            names += own.names
            regions += own.regions
        else:
            names += [_of_flow(name) for name in own.names]
            regions += [
                {**{k: v for k, v in region.items() if k != "axis"}, "channel": "flow"}
                for region in own.regions
            ]
    return Atoms(tuple(names), tuple(kinds), tuple(regions), np.column_stack(values))


def _of_flow(name: str) -> str:
    for force, flow in FLOW_AXES.items():
        name = name.replace(force, flow)
    return f"the images: {name}"
