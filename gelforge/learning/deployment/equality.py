"""Whether a converted model answers as PyTorch's does: each output on trial features, within a limit of its own."""

from __future__ import annotations

import numpy as np

from gelforge.indentation.sensor.symmetry import D4
from gelforge.learning.basis.scaling import ModelError, Scaling
from gelforge.learning.basis.turns import turned_flow
from gelforge.learning.deployment.onnx_check import Difference
from gelforge.learning.deployment.onnx_model import OnnxModel
from gelforge.learning.models.familiarity import Familiar
from gelforge.learning.models.model_file import Model

# Single precision in another order of sums gives 1e-6 through all layers of a network; a wrong sign, axis or padding 1e-1.
FORCE_LIMIT = 1e-4
# The iterations of inverse elasticity make its rounding 50 times larger: 6e-5 measured.
INVERSE_LIMIT = 1e-3
# Lengths and projections are single sums: 3e-7 measured with 3200 features. A wrong mean, component or scale gives 1e-2.
STATISTIC_LIMIT = 1e-5
NEAR = 8  # trial images that the training set's components span
OFF_SHARE = 1e-4  # of their length that lies outside


def check_equal(model: Model, converted: OnnxModel, where: str) -> list[Difference]:
    """Return the largest difference of each output on trial features; raise ModelError naming those above their limits."""
    found = differences(model, converted)
    if wrong := [str(difference) for difference in found if not difference.within]:
        raise ModelError(
            f"{where}: not exported, ONNX Runtime and PyTorch differ in {'; in '.join(wrong)}; update torch, onnx and "
            "onnxruntime, or report the network's settings"
        )
    return found


def differences(model: Model, converted: OnnxModel) -> list[Difference]:
    """Return the largest difference of each output on trial features: forces, then the statistics of familiarity."""
    trials = trial_features(model)
    limit = INVERSE_LIMIT if model.reads_inverse else FORCE_LIMIT
    worst = [_force_difference(model, converted, feature) for feature in trials]
    found = [Difference("forces", max(worst), limit, "an image's largest force")]
    if model.familiar:
        shares = [
            statistic_shares(
                model.familiar,
                model.familiar.statistics(model.scaling.inputs(feature)),
                converted.statistics(feature),
            )
            for feature in trials
        ]
        names = "the inputs' length", "their distance from the training set's components", "their T"
        lengths = "the inputs' length"
        of = lengths, lengths, f"{lengths} in the smallest standard deviation"
        largest = np.max(shares, axis=0).tolist()
        found += [
            Difference(name, share, STATISTIC_LIMIT, unit) for name, share, unit in zip(names, largest, of)
        ]
    return found


def _force_difference(model: Model, converted: OnnxModel, feature: np.ndarray) -> float:
    """Return the largest difference of raw forces, as a share of an image's largest or of the labels' deviation."""
    expected, found = model.predict_raw(feature), converted.predict_raw(feature)
    size = np.maximum(np.abs(expected).max(axis=(1, 2)), model.scaling.output_scale.max())
    return _finite((np.abs(found - expected).max(axis=(1, 2)) / size).max())


def statistic_shares(familiar: Familiar, expected: np.ndarray, found: np.ndarray) -> list[float]:
    """Return the largest difference of each of the statistics (n, 3) as a share of what rounds in it.

    Inputs and mean are subtracted, so that their lengths round in each; T divides by the deviation along a component.
    """
    expected, found = np.array(expected, float), np.array(found, float)
    expected[:, 2], found[:, 2] = np.sqrt(expected[:, 2]), np.sqrt(found[:, 2])
    size = np.maximum(expected[:, 0] + np.linalg.norm(familiar.mean), np.finfo(np.float32).tiny)
    unit = np.stack([size, size, size / familiar.deviation.min()], axis=1)
    return [_finite(share) for share in (np.abs(found - expected) / unit).max(axis=0)]


def _finite(share: float) -> float:
    return float(share) if np.isfinite(share) else np.inf


def trial_features(model: Model) -> list[np.ndarray]:
    """Return batches of features (n, F): at rest, on the branch cut of directions, far out, drawn, and as in training."""
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
    batches = [np.array([features(*edge) for edge in edges]), np.array(drawn[:1]), np.array(drawn)]
    if model.familiar:
        spanned = features_of(spanned_inputs(model.familiar, rng), scaling)
        batches += [spanned, spanned[:1]]
    return batches


def spanned_inputs(familiar: Familiar, rng: np.random.Generator) -> np.ndarray:
    """Return inputs (n, F) like those of training: along the components, and hardly anything outside them."""
    components = familiar.components
    along = rng.normal(size=(NEAR, len(components))) * familiar.deviation @ components
    outside = rng.normal(size=along.shape)
    outside *= OFF_SHARE * np.linalg.norm(along, axis=1, keepdims=True) / outside.shape[1] ** 0.5
    return (familiar.mean + along + outside).astype(np.float32)


def features_of(inputs: np.ndarray, scaling: Scaling) -> np.ndarray:
    """Return the features (n, F) of which `scaling.inputs` makes these inputs."""
    half = inputs.shape[1] // 2
    flow = inputs * np.repeat(scaling.input_scale, half) + scaling.input_mean
    if scaling.form == "polar":
        return flow
    back = next(name for name in D4 if np.array_equal(D4[name], D4[scaling.turn].T))
    u, v = turned_flow(back, flow.reshape(-1, 2, half), round(half**0.5)).transpose(1, 0, 2)
    return np.concatenate([np.hypot(u, v), np.arctan2(v, u)], axis=1)
