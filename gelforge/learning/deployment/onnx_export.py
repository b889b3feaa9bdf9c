"""A trained model as an ONNX file: written from PyTorch, and compared with it before anybody uses it."""

from __future__ import annotations

import contextlib
import io
import json
import logging
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import nn

from gelforge import __version__
from gelforge.files import UNSEALED, atomic, file_sha256
from gelforge.indentation.sensor.symmetry import D4
from gelforge.learning.basis.scaling import Scaling
from gelforge.learning.basis.turns import order
from gelforge.learning.deployment.equality import check_equal
from gelforge.learning.deployment.onnx_check import Difference
from gelforge.learning.deployment.onnx_model import (
    FORMAT,
    INPUT,
    KEY,
    OUTPUT,
    OnnxModel,
    model_of,
    packed,
)
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.elasticity.unrolled import Unrolled
from gelforge.learning.models.model_file import LARGEST_OUTPUT, Model, load_model

OPSET = 20  # of ONNX 1.15 (2023), which ONNX Runtime 1.17 and newer read
UNITS = {
    "features": "magnitudes [px], then directions [rad], regions row by row from the image's top left",
    "force_N": "on the sensor [N], bins k = nx iy + ix, axes x, y, z (z up: an indentation is negative)",
}


class FeaturesToNewtons(nn.Module):
    """The network with its scaling: features (n, F) to forces of the bins (n, B, 3) [N], as `Scaling` and `Model` do it."""

    input_mean: torch.Tensor
    input_scale: torch.Tensor
    output_mean: torch.Tensor
    output_scale: torch.Tensor
    places: torch.Tensor
    plane: torch.Tensor

    def __init__(self, network: nn.Module, scaling: Scaling, inverse: Inverse | None = None):
        """inverse: whose forces the network reads."""
        super().__init__()
        self.inverse = Unrolled(inverse) if inverse else None
        self.network, self.form, self.turn = network, scaling.form, scaling.turn
        half = len(scaling.input_mean) // 2
        n = round(half**0.5)
        keep = {"input_mean": scaling.input_mean, "output_mean": scaling.output_mean}
        keep |= {"input_scale": np.repeat(scaling.input_scale, half), "output_scale": scaling.output_scale}
        for name, values in keep.items():
            self.register_buffer(name, torch.from_numpy(np.asarray(values, np.float32)))
        if self.turn != "identity":
            self.register_buffer("places", torch.from_numpy(order(self.turn, n, n)))
            self.register_buffer("plane", torch.tensor(D4[self.turn], dtype=torch.float32))

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        flow, more = features, []
        if self.form != "polar":
            magnitude, direction = features.unflatten(1, (2, -1)).unbind(1)
            flow = torch.stack([magnitude * torch.cos(direction), magnitude * torch.sin(direction)], dim=1)
            if self.inverse is not None:
                more = [self.inverse(flow.flatten(1))]
            if self.turn != "identity":
                flow = torch.matmul(self.plane, flow[:, :, self.places])
            flow = flow.flatten(1)
        inputs = (flow - self.input_mean) / self.input_scale
        outputs = self.network(torch.cat([inputs, *more], dim=1))
        return outputs.unflatten(1, (-1, 3)) * self.output_scale + self.output_mean


def export_onnx(model_path: str | Path, out: str | Path) -> list[Difference]:
    """Write a model.pt as an ONNX file; nothing is written if its outputs differ from PyTorch's.

    Parameters
    ----------
    model_path : str or Path
        model.pt.
    out : str or Path
        The ONNX file.

    Returns
    -------
    list of Difference
        Largest difference of each output from PyTorch's.

    Raises
    ------
    ModelError
        Where one is above its limit.
    """
    model = load_model(model_path)
    content = onnx_bytes(model, file_sha256(model_path))
    compared = check_equal(model, model_of(content, str(out)), str(model_path))
    with atomic(out, sealed=True) as temporary:
        temporary.write_bytes(content)
    return compared


def converted(path: str | Path, threads: int = 1) -> OnnxModel:
    """Return a model.pt as its ONNX model, made in memory (some seconds) and checked."""
    model = load_model(path)
    onnx_model = model_of(onnx_bytes(model, file_sha256(path)), str(path), threads)
    check_equal(model, onnx_model, str(path))
    return onnx_model


def onnx_bytes(model: Model, sha256: str) -> bytes:
    """Return a model as the bytes of an ONNX file, which keeps a place for its own checksum; any number of rows n."""
    inverse = model.inverse if model.reads_inverse else None
    network = FeaturesToNewtons(model.network, model.scaling, inverse).eval()
    example = torch.zeros(2, len(model.scaling.input_mean))
    logs = logging.getLogger("torch.onnx")
    level = logs.level
    logs.setLevel(logging.ERROR)  # it speaks of torchvision, which nothing here needs
    try:
        with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                network,
                (example,),
                dynamo=True,
                opset_version=OPSET,
                input_names=[INPUT],
                output_names=[OUTPUT],
                dynamic_shapes=({0: torch.export.Dim("n")},),
                verbose=False,
            )
    finally:
        logs.setLevel(level)
    assert program is not None  # of dynamo=True
    proto = program.model_proto
    proto.producer_name, proto.producer_version = "gelforge", __version__
    proto.doc_string = UNSEALED.decode()  # stands before the graph, where a checksum is looked for
    entry = proto.metadata_props.add()
    entry.key, entry.value = KEY, json.dumps(metadata(model, sha256), sort_keys=True, allow_nan=False)
    return proto.SerializeToString(deterministic=True)


def metadata(model: Model, sha256: str) -> dict:
    """Return what an ONNX file says of itself; numbers and text only."""
    plain = {k: v.tolist() for k, v in asdict(model.intervals).items()} if model.intervals else None
    return {
        "format": FORMAT,
        "version": __version__,
        "model_sha256": sha256,
        "settings": model.settings,
        "units": UNITS,
        "zero": asdict(model.zero),
        "intervals": plain,
        "check": _check(model),
        "largest_N": (LARGEST_OUTPUT * model.scaling.output_scale.astype(float)).tolist(),
    }


def _check(model: Model) -> dict | None:
    """Return the check of totals with the inverse that it needs; single precision as text."""
    if model.inverse is None or model.check is None:
        return None
    arrays = {name: packed(getattr(model.inverse, name)) for name in ("left", "singular", "right")}
    check = {"gain": model.check.gain.tolist(), "share": model.check.share}
    return check | {"inverse": arrays | {"friction": model.inverse.friction}}
