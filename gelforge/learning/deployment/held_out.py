"""Forces of held-out images by ONNX Runtime, from the images as `gelforge predict` computes them, against PyTorch's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gelforge.config import Session
from gelforge.hdf5 import opened
from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.deployment.onnx_check import Difference, OnnxCheck
from gelforge.learning.deployment.onnx_model import OnnxModel
from gelforge.learning.deployment.predictor import Prediction, Predictor, predict_frames
from gelforge.learning.judging.predictions import Predictions
from gelforge.learning.models.reliability import Zero
from gelforge.recording.features import FORMAT as FEATURE_FORMAT
from gelforge.recording.imaging.flow import read_grey
from gelforge.recording.imaging.frames import Frame
from gelforge.recording.imaging.images import image_path, reference_path

IMAGES = 40  # compared
# Of the largest force, and of the check of totals (1 where that is less). Measured: 1e-6 on one machine; the flow of
# another processor's instructions may differ by 1e-4. Another reference, crop or remap gives 1e-1.
LIMIT = 1e-3


@dataclass(frozen=True)
class HeldOut:
    """Rows of a predictions file: images of one session's held-out sites, and what PyTorch says of them."""

    session: str
    images: tuple[str, ...]  # file names
    sites: int
    force_N: np.ndarray  # (n, B, 3)
    label_N: np.ndarray  # (n, B, 3)
    disagreement: np.ndarray  # (n,)


def held_out(predictions: Predictions, session: str, feature_file: str | Path) -> HeldOut | None:
    """Return at most IMAGES held-out rows of a session, evenly spread.

    Parameters
    ----------
    predictions : Predictions
        On held-out rows.
    session : str
        Its name.
    feature_file : str or Path
        Its features, which name the images.

    Returns
    -------
    HeldOut or None
        None where no row is of this session.

    Raises
    ------
    ModelError
        For a file of features that is damaged or lacks an image.
    """
    rows = np.flatnonzero(predictions.session == session)
    if not len(rows):
        return None
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), IMAGES)).round().astype(int))]
    remedy = f"extract the features again (snakemake -R {feature_file})"
    with opened(feature_file, FEATURE_FORMAT, remedy, ModelError) as file:
        keys = zip(file["press"].asstr()[()], file["image_index"][()].tolist())
        named = dict(zip(keys, file["image"].asstr()[()]))
    kept: list[tuple] = []
    for block, *columns in predictions.columns("press", "image_index", "cell", "predicted_N", "true_N"):
        within = rows[(rows >= block.start) & (rows < block.stop)] - block.start
        kept += zip(*(column[within] for column in columns))
    presses, indices, cells, force, label = zip(*kept)
    try:
        images = tuple(named[press.decode(), int(index)] for press, index in zip(presses, indices))
    except KeyError as error:
        raise ModelError(
            f"{feature_file}: image {error} (indentation, number) of {predictions.path} is missing; "
            f"evaluate the model again (snakemake -R {predictions.path})"
        ) from None
    known = np.array(force), np.array(label), predictions.disagreement[rows]
    return HeldOut(session, images, len(set(cells)), *known)


def check_held_out(
    model: str | Path, known: HeldOut, model_sha256: str, folder: Path, session: Session
) -> OnnxCheck:
    """Return how far ONNX Runtime's forces of images are from PyTorch's.

    Parameters
    ----------
    model : str or Path
        model.onnx.
    known : HeldOut
        What PyTorch says.
    model_sha256 : str
        Of the model with which it does.
    folder : Path
        Session that holds the images.
    session : Session
        Its camera and crop.

    Returns
    -------
    OnnxCheck
        Differences [-] of forces and of the check of totals.

    Raises
    ------
    ModelError
        Where a difference is above LIMIT, or the file was exported from another model.
    """
    predictor = Predictor(model)
    if predictor.model.model_sha256 != model_sha256:
        raise ModelError(
            f"{model}: exported from another model than the one whose predictions are compared; export it again "
            f"(snakemake -R {model})"
        )
    frames = (Frame(name, float("nan"), read_grey(image_path(folder, name))) for name in known.images)
    camera = session.camera if session.remap else None
    reference = read_grey(reference_path(folder))
    shown = list(predict_frames(predictor, frames, reference, session.crop_px, camera))
    off_N = force_differences(predictor.model, shown, known.force_N)
    # 1e-9 where nothing touches
    largest_N = float(max(np.abs(known.force_N).max(), np.abs(known.label_N).max(), 1e-9))
    outputs = [Difference("forces", float(off_N.max() / largest_N), LIMIT, "the largest force")]
    if predictor.model.check:
        share = float(disagreement_differences(predictor.model, shown, known.disagreement).max())
        outputs.append(Difference("the check of totals", share, LIMIT, "its value, at least 1"))
    if wrong := [str(output) for output in outputs if not output.within]:
        raise ModelError(
            f"{model}: on {len(shown)} held-out images of session {known.session} ONNX Runtime differs from PyTorch in "
            f"{'; in '.join(wrong)}; evaluate and export the model again on one machine, or set learning.onnx: false"
        )
    touched = int(np.any(known.force_N, axis=(1, 2)).sum())
    sizes = touched, largest_N, float(off_N.max())
    return OnnxCheck(model_sha256, known.session, len(shown), known.sites, *sizes, tuple(outputs))


def force_differences(
    model: OnnxModel, predictions: Sequence[Prediction], expected: np.ndarray
) -> np.ndarray:
    """Return how far forces are from those expected (n, B, 3) [N]."""
    return np.min([np.abs(force - expected) for force in _forces(model, predictions)], axis=0)


def disagreement_differences(
    model: OnnxModel, predictions: Sequence[Prediction], expected: np.ndarray
) -> np.ndarray:
    """Return how far the check of totals is from that expected (n,), as a share of it where it is above 1."""
    assert model.inverse is not None and model.check is not None
    feature = np.array([prediction.feature for prediction in predictions])
    inverse_total = model.inverse.forces(feature).sum(axis=1)
    totals = (force.sum(axis=1) for force in _forces(model, predictions)[1:])
    answers = [model.check.disagreement(total, inverse_total) for total in totals]
    answers.append(np.array([prediction.disagreement for prediction in predictions]))
    return np.min([np.abs(answer - expected) for answer in answers], axis=0) / np.maximum(expected, 1)


def _forces(model: OnnxModel, predictions: Sequence[Prediction]) -> list[np.ndarray]:
    """Return forces (n, B, 3) [N], and those of thresholds of exact zeros that differ by LIMIT.

    A force that lies within LIMIT of a threshold may be zero in one and not in the other.
    """
    raw = model.predict_raw(np.array([prediction.feature for prediction in predictions]))
    zeros = [Zero(k * model.zero.contact_N, k * model.zero.bin_N) for k in (1 - LIMIT, 1 + LIMIT)]
    said = np.array([prediction.force_N for prediction in predictions])
    return [said, *(zero.applied(raw) for zero in zeros)]
