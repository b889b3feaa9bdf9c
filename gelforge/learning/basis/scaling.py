"""The scaling between features and a network's inputs, and between its outputs and newtons."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gelforge.learning.basis.turns import turned_flow

FORMS = ("vector", "polar")


class ModelError(ValueError):
    """A model that cannot be made or used: file, what was found, what to do."""


@dataclass(frozen=True)
class Scaling:
    """How features become inputs of unit size and outputs become newtons; measured on training rows only.

    inputs = (features - mean) / scale; where form is "vector", each region's (magnitude, direction) is first turned
    into (magnitude cos direction, magnitude sin direction), which does not jump at +-pi. scale is one number for the
    first half of the inputs and one for the second, so that regions that hardly move stay small instead of becoming
    noise of unit size. newtons = outputs * output_scale + output_mean, one scale per axis.
    """

    form: str  # "vector" or "polar"
    turn: str  # the element of D4 that carries the image onto the sensor, of components only
    input_mean: np.ndarray  # (F,) float32
    input_scale: np.ndarray  # (2,) float32
    output_mean: np.ndarray  # (B, 3) float32 [N]
    output_scale: np.ndarray  # (3,) float32 [N]

    def inputs(self, feature: np.ndarray) -> np.ndarray:
        """Return network inputs (n, F) float32 of features (n, F)."""
        flow = input_flow(feature, self.form, self.turn)
        flow -= self.input_mean
        half = flow.shape[-1] // 2
        flow[..., :half] /= self.input_scale[0]
        flow[..., half:] /= self.input_scale[1]
        return flow

    def targets(self, label: np.ndarray) -> np.ndarray:
        """Return network outputs (n, 3 B) float32 that stand for labels (n, B, 3) [N]."""
        scaled = (label - self.output_mean) / self.output_scale
        return scaled.reshape(len(label), -1).astype(np.float32)

    def newtons(self, outputs: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of network outputs (n, 3 B)."""
        return outputs.reshape(len(outputs), -1, 3) * self.output_scale + self.output_mean


def input_flow(feature: np.ndarray, form: str, turn: str = "identity") -> np.ndarray:
    """Return unscaled inputs (n, F) float32 of features (n, F): a copy, or the regions' flow components [px], turned."""
    if form == "polar":
        return np.array(feature, dtype=np.float32)
    half = feature.shape[-1] // 2
    flow = np.empty((len(feature), 2, half), dtype=np.float32)
    magnitude, direction = feature[..., :half], feature[..., half:]
    np.multiply(magnitude, np.cos(direction), out=flow[:, 0])
    np.multiply(magnitude, np.sin(direction), out=flow[:, 1])
    if turn != "identity":
        flow = turned_flow(turn, flow, round(half**0.5))
    return flow.reshape(len(feature), -1)
