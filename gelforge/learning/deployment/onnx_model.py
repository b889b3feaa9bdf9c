"""A trained model in ONNX Runtime: from features to newtons in one graph, with what the file says of itself.

The graph takes features (n, F) [px, rad] and gives what the network says (n, B, 3) [N]. Exact zeros, intervals and the
check of totals are worked out here by the classes that PyTorch's model uses; their numbers travel in the file's metadata,
under the key `gelforge`.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import onnxruntime

from gelforge.files import check_seal
from gelforge.learning.basis.scaling import ModelError, input_flow
from gelforge.learning.elasticity.check import Check
from gelforge.learning.elasticity.inverse import ITERATIONS, WARM_ITERATIONS, Inverse, State
from gelforge.learning.models.reliability import Intervals, Zero

FORMAT = "gelforge-onnx-3"
KEY = "gelforge"  # of the metadata
INPUT, OUTPUT = "features", "force_N"
REMEDY = "export the model again (gelforge export --model model.pt --out model.onnx)"


@dataclass(frozen=True)
class OnnxModel:
    """A network in ONNX Runtime that answers as `Model` does."""

    session: onnxruntime.InferenceSession
    settings: dict  # as Model.settings
    zero: Zero
    intervals: Intervals | None
    inverse: Inverse | None
    check: Check | None
    largest_N: np.ndarray  # (3,) forces that no training gives
    model_sha256: str  # of the model.pt that it comes from
    where: str = field(default="the model")  # named in messages

    def predict(self, feature: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of features (n, F): exactly zero where nothing touches.

        Raises ModelError for features or forces that are not finite, or forces that no training gives.
        """
        return self.zero.applied(self.predict_raw(feature))

    def predict_raw(self, feature: np.ndarray) -> np.ndarray:
        """Return the same as the network says it, small forces where nothing touches included."""
        feature = np.atleast_2d(np.asarray(feature, np.float32))
        if not np.isfinite(feature).all():
            bad = int((~np.isfinite(feature)).sum())
            raise ModelError(f"the predicted force is not finite, {bad} features are not; check the images")
        (force,) = self.session.run(None, {INPUT: feature})
        if not np.isfinite(force).all():
            raise ModelError(f"the predicted force is not finite though all features are; {REMEDY}")
        if (np.abs(force) > self.largest_N).any():
            raise ModelError(
                f"a predicted force is {np.abs(force).max():.3g} N, limit {self.largest_N.max():.3g} N; check the images, "
                "and the model's file"
            )
        return force

    def answer(self, feature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what predict does, and how far its totals are from those of inverse elasticity (n,); NaN: not known."""
        return self.follow(feature)[:2]

    def follow(
        self, feature: np.ndarray, state: State | None = None
    ) -> tuple[np.ndarray, np.ndarray, State | None]:
        """Return the same of the frame after the one that a state is of, in fewer iterations, and the frame's state."""
        force = self.predict(feature)
        if self.inverse is None or self.check is None:
            return force, np.full(len(force), np.nan), None
        flow = input_flow(np.atleast_2d(feature), "vector")
        state = self.inverse.solve(flow, WARM_ITERATIONS if state else ITERATIONS, state)
        total = state.force.reshape(force.shape).sum(axis=1)
        return force, self.check.disagreement(force.sum(axis=1), total), state


def load_onnx(path: str | Path, threads: int = 1) -> OnnxModel:
    """Return an exported model. Raises ModelError, in one line, for a file that is missing, damaged, foreign or of
    another version."""
    path = Path(path)
    try:
        check_seal(path, REMEDY, ModelError)
        content = path.read_bytes()
    except ModelError as error:
        if "no checksum" not in str(error):
            raise
        raise ModelError(f"{path}: cut short, or no model that gelforge has exported; {REMEDY}") from None
    return model_of(content, str(path), threads)


def open_for_prediction(path: str | Path, threads: int = 1) -> OnnxModel:
    """Return the model of a .onnx file, or of a model.pt, which is converted in memory (some seconds) and checked."""
    if Path(path).suffix.lower() == ".onnx":
        return load_onnx(path, threads)
    # PyTorch, which an exported model does without
    from gelforge.learning.deployment.onnx_export import converted

    return converted(path, threads)


def model_of(content: bytes, where: str, threads: int = 1) -> OnnxModel:
    """Return the model of a file's bytes; where names it in messages."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads, options.inter_op_num_threads = threads, 1
    options.log_severity_level = 4  # what goes wrong is said by our own messages
    try:
        session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime raises a class of its own for each kind of damage
        raise ModelError(f"{where}: ONNX Runtime cannot read it ({type(error).__name__}); {REMEDY}") from None
    metadata = session.get_modelmeta().custom_metadata_map.get(KEY)
    if metadata is None:
        raise ModelError(f"{where}: an ONNX file, but not one that gelforge has exported; {REMEDY}")
    try:
        return _from_metadata(session, json.loads(metadata), where)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, ModelError):
            raise
        what = str(error).splitlines()[0][:200]
        raise ModelError(
            f"{where}: its metadata lack or spoil {type(error).__name__} {what}; {REMEDY}"
        ) from None


def _from_metadata(session, metadata: dict, where: str) -> OnnxModel:
    if metadata.get("format") != FORMAT:
        raise ModelError(
            f"{where}: of format {metadata.get('format')!r}, this version reads {FORMAT!r}; {REMEDY}"
        )
    settings, bins = metadata["settings"], metadata["settings"]["bins"]
    taken, given = session.get_inputs(), session.get_outputs()
    count = 2 * settings["features"]["regions"] ** 2
    shape = [bins["nx"] * bins["ny"], 3]
    if [i.name for i in taken] != [INPUT] or taken[0].shape[1:] != [count]:
        raise ModelError(
            f"{where}: its input is {[(i.name, i.shape) for i in taken]}, {count} features are expected; {REMEDY}"
        )
    if [o.name for o in given] != [OUTPUT] or given[0].shape[1:] != shape:
        raise ModelError(
            f"{where}: its output is {[(o.name, o.shape) for o in given]}, forces {shape} are expected; {REMEDY}"
        )
    intervals = metadata["intervals"]
    return OnnxModel(
        session,
        settings,
        Zero(**metadata["zero"]),
        Intervals(**{name: np.array(values) for name, values in intervals.items()}) if intervals else None,
        *_check(metadata["check"]),
        np.array(metadata["largest_N"]),
        metadata["model_sha256"],
        where,
    )


def _check(about: dict | None) -> tuple[Inverse | None, Check | None]:
    if about is None:
        return None, None
    arrays = {name: unpacked(about["inverse"][name]) for name in ("left", "singular", "right")}
    inverse = Inverse(**arrays, friction=about["inverse"]["friction"])
    return inverse, Check(np.array(about["gain"]), about["share"])


def packed(values: np.ndarray) -> dict:
    """Return an array in single precision as text."""
    content = np.ascontiguousarray(values, "<f4").tobytes()
    return {"shape": list(values.shape), "float32": base64.b64encode(content).decode()}


def unpacked(content: dict) -> np.ndarray:
    """Return the array that `packed` was given."""
    return np.frombuffer(base64.b64decode(content["float32"]), "<f4").reshape(content["shape"])
