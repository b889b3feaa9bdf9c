"""Whether a converted model answers as PyTorch's does: each output on trial features, within a limit of its own."""

from __future__ import annotations

import numpy as np

from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.deployment.onnx_check import Difference
from gelforge.learning.deployment.onnx_model import OnnxModel
from gelforge.learning.models.model_file import Model

# Single precision (2^-24 = 6e-8, IEEE 754-2019) in another order of sums gives 1e-6 through all layers of a network; a
# wrong sign, axis or padding 1e-1.
FORCE_LIMIT = 1e-4
# The iterations of inverse elasticity make its rounding 50 times larger: 6e-5 measured.
INVERSE_LIMIT = 1e-3


def check_equal(model: Model, converted: OnnxModel, where: str) -> list[Difference]:
    """Return the largest difference of each output on trial features; raise ModelError naming those above their limits."""
    compared = differences(model, converted)
    if wrong := [str(difference) for difference in compared if not difference.within]:
        raise ModelError(
            f"{where}: not exported, ONNX Runtime and PyTorch differ in {'; in '.join(wrong)}; update torch, onnx and "
            "onnxruntime, or report the network's settings"
        )
    return compared


def differences(model: Model, converted: OnnxModel) -> list[Difference]:
    """Return the largest difference of each output on trial features."""
    trials = trial_features(model)
    limit = INVERSE_LIMIT if model.reads_inverse else FORCE_LIMIT
    worst = [_force_difference(model, converted, feature) for feature in trials]
    return [Difference("forces", max(worst), limit, "an image's largest force")]


def _force_difference(model: Model, converted: OnnxModel, feature: np.ndarray) -> float:
    """Return the largest difference of raw forces, as a share of an image's largest or of the labels' deviation."""
    expected, predicted = model.predict_raw(feature), converted.predict_raw(feature)
    size = np.maximum(np.abs(expected).max(axis=(1, 2)), model.scaling.output_scale.max())
    share = (np.abs(predicted - expected).max(axis=(1, 2)) / size).max()
    return float(share) if np.isfinite(share) else np.inf


def trial_features(model: Model) -> list[np.ndarray]:
    """Return batches of features (n, F): at rest, on the branch cut of directions, far out, and drawn."""
    scaling = model.scaling
    half = len(scaling.input_mean) // 2
    rng, size = np.random.default_rng(0), float(scaling.input_scale[0])

    def features(magnitude, direction):
        parts = np.broadcast_to(magnitude, (half,)), np.broadcast_to(direction, (half,))
        return np.concatenate(parts).astype(np.float32)

    edges = [(0.0, 0.0), (0.0, np.pi), (size, np.pi), (size, -np.pi), (size, np.pi / 2), (30 * size, 0.3)]
    drawn = [
        features(scale * size * np.abs(rng.normal(size=half)), rng.uniform(-np.pi, np.pi, half))
        for scale in (0.1, 1, 1, 3, 10)
    ]
    return [np.array([features(*edge) for edge in edges]), np.array(drawn[:1]), np.array(drawn)]
