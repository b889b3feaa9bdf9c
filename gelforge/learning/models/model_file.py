"""A trained network with its scaling and settings, and the file that keeps them."""

from __future__ import annotations

import io
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from gelforge.config import Learning
from gelforge.files import atomic, check_seal
from gelforge.indentation.sensor.symmetry import D4
from gelforge.learning.basis.network import Grids
from gelforge.learning.basis.scaling import FORMS, ModelError, Scaling
from gelforge.learning.elasticity.check import Check
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.models.reliability import Intervals, Zero
from gelforge.learning.networks import make_network, network_of

FORMAT = "gelforge-model-4"
# settings that decide a training, by their names in a study; shards have a digest, and views are theirs
DECIDING = {
    **{name: name for name in ("seed", "features", "dataset", "learning")},
    "bins": "sensor.bins",
    "sensor_width_mm": "the sensor's width [mm]",
}
PARTS = {"zero": Zero, "intervals": Intervals, "inverse": Inverse, "check": Check}  # of a model in its file
LARGEST_OUTPUT = 1e4  # in units of Scaling.output_scale; trained networks stay below some hundred


@dataclass(frozen=True)
class Model:
    """A network with its scaling, the settings it was trained with and what its features need."""

    network: nn.Module
    scaling: Scaling
    settings: dict  # learning, features and bins of the study, seed, digest of the dataset
    zero: Zero = field(default_factory=Zero)
    intervals: Intervals | None = None  # None: too few validation rows
    inverse: Inverse | None = None  # None: sensor or camera are not described so that it is known
    check: Check | None = None  # of totals against the inverse's; None: no inverse, or few rows

    def predict(self, feature: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of features (n, F): exactly zero where nothing touches.

        Raises ModelError for features or forces that are not finite, or forces that no training gives.
        """
        return self.zero.applied(self.predict_raw(feature))

    def inputs(self, feature: np.ndarray) -> np.ndarray:
        """Return the network's inputs (n, M) float32 of features (n, F)."""
        flow = self.scaling.inputs(feature)
        if not self.reads_inverse:
            return flow
        assert self.inverse is not None  # a file without it is refused
        return np.concatenate([flow, self.inverse.inputs(feature)], axis=1)

    @property
    def reads_inverse(self) -> bool:
        return network_of(self.settings["learning"]["network"]).reads_inverse

    def predict_raw(self, feature: np.ndarray) -> np.ndarray:
        """Return the same as the network says it, small forces where nothing touches included."""
        feature = np.atleast_2d(feature)
        if bad := int((~np.isfinite(feature)).sum()):
            raise ModelError(f"the predicted force is not finite, {bad} features are not; check the images")
        self.network.eval()
        with torch.inference_mode():
            outputs = self.network(torch.from_numpy(self.inputs(feature))).numpy()
        newtons = self.scaling.newtons(outputs)
        if not np.isfinite(newtons).all():
            raise ModelError(
                "the predicted force is not finite though all features are; check the model's file"
            )
        if np.abs(outputs).max(initial=0) > LARGEST_OUTPUT:
            raise ModelError(
                f"a predicted force is {np.abs(outputs).max():.3g} times the labels' standard deviation, limit "
                f"{LARGEST_OUTPUT:g}; check the images, and the model's file"
            )
        return newtons

    def disagreement(self, feature: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Return how far the totals of predicted forces (n, B, 3) are from those of inverse elasticity (n,).

        Beyond 1 a row is marked; NaN: not known. feature (n, F): of which the forces were predicted.
        """
        if self.inverse is None or self.check is None:
            return np.full(len(force), np.nan)
        return self.check.disagreement(force.sum(axis=1), self.inverse.forces(feature).sum(axis=1))


def save_model(path: str | Path, model: Model) -> None:
    """Write weights, scaling and settings as one file, whole or not at all; it holds tensors, numbers and text only.

    Parameters
    ----------
    path : str or Path
        The file.
    model : Model
        The network with its scaling, settings and thresholds.
    """
    content = {
        "format": FORMAT,
        "weights": model.network.state_dict(),
        "scaling": _tensors(model.scaling),
        "settings": model.settings,
    }
    save_tensors(path, content | {name: _tensors(getattr(model, name)) for name in PARTS})


def _tensors(values) -> dict | None:
    return values and {
        k: torch.from_numpy(v) if isinstance(v, np.ndarray) else v for k, v in asdict(values).items()
    }


def _arrays(values: dict) -> dict:
    return {k: v.numpy() if isinstance(v, torch.Tensor) else v for k, v in values.items()}


def save_tensors(path: str | Path, content: dict) -> None:
    """Write tensors, numbers and text; the same content gives the same bytes under any file name."""
    buffer = io.BytesIO()  # torch.save puts the name of a file that it opens itself into the archive
    torch.save(content, buffer)
    with atomic(path, sealed=True) as temporary:
        temporary.write_bytes(buffer.getvalue())


def load_tensors(path: str | Path, kind: str) -> dict:
    """Return what save_tensors wrote, refusing anything but tensors, numbers and text (no code is run)."""
    remedy = f"train the model again (snakemake -R {path})"
    check_seal(path, remedy, ModelError)
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises several kinds for what is no archive of tensors
        raise ModelError(f"{path}: no tensors can be read ({type(error).__name__}); {remedy}") from None
    if not isinstance(content, dict) or content.get("format") != kind:
        raise ModelError(f"{path}: not a file of format {kind!r}; {remedy}")
    return content


def check_trained_on(path: str | Path, settings: dict) -> None:
    """Refuse a model that was trained with other settings, or on other shards, than a study's.

    What an older model does not state is not compared.

    Parameters
    ----------
    path : str or Path
        The model's file.
    settings : dict
        Of the study, as `Model.settings`.

    Raises
    ------
    ModelError
        Names what differs.
    """
    model, remedy = load_model(path).settings, f"train the model again (snakemake -R {path})"
    complete = Learning.model_validate(model["learning"]).usual
    known = _by_key(model | {"learning": complete.model_dump(mode="json", exclude={"onnx"})})
    now = _by_key(settings)
    differing = [
        f"{key}: {value} in the model, {now.get(key)} in the study"
        for key, value in known.items()
        if now.get(key) != value
    ]
    if differing:
        raise ModelError(f"{path}: trained with other settings, {'; '.join(differing)}; {remedy}")
    if model.get("shards_digest") != settings["shards_digest"]:
        raise ModelError(f"{path}: was trained on other shards than the study's; {remedy}")


def _by_key(settings: dict) -> dict:
    """Return the settings that decide a training, by their dotted keys of a study."""
    by_key: dict[str, object] = {}
    for part, name in DECIDING.items():
        values = settings.get(part)
        if isinstance(values, dict):
            by_key |= {f"{name}.{key}": value for key, value in values.items()}
        elif values is not None:
            by_key[name] = values
    return by_key


def load_model(path: str | Path) -> Model:
    """Return a saved model, ready to predict.

    Parameters
    ----------
    path : str or Path
        model.pt of a study.

    Returns
    -------
    Model
        Network, scaling, settings, thresholds and intervals.

    Raises
    ------
    ModelError
        For a file that is missing or damaged, or whose numbers are no trained network's.
    """
    if not Path(path).exists():
        raise ModelError(f"{path}: no such file; a study's model is results/<study>/model/model.pt")
    content = load_tensors(path, FORMAT)
    try:
        model = _model_from(content)
    except (KeyError, TypeError, ValueError, RuntimeError, AttributeError) as error:  # torch: RuntimeError
        what = str(error).splitlines()[0][:200]
        raise ModelError(f"{path}: {type(error).__name__} {what}; train the model again") from None
    if wrong := implausible(model):
        raise ModelError(f"{path}: {wrong}; train the model again (snakemake -R {path})")
    return model


def implausible(model: Model) -> str:
    """Return why a network cannot be one that was trained; "" where nothing speaks against it.

    A wrong exponent is seen where inputs of unit size give outputs that no training gives.
    """
    scaling, state = model.scaling, model.network.state_dict()
    numbers = {f"weights {name}": values.numpy() for name, values in state.items()}
    kept = [part for part in (scaling, model.zero, model.intervals, model.inverse, model.check) if part]
    numbers |= {k: v for part in kept for k, v in vars(part).items() if isinstance(v, np.ndarray)}
    for name, values in numbers.items():
        if not np.isfinite(values).all():
            return f"{name}: {(~np.isfinite(values)).sum()} of {values.size} numbers are not finite"
    if scaling.form not in FORMS or scaling.turn not in D4:
        return f"scaling of form {scaling.form!r} and turn {scaling.turn!r}"
    if min(scaling.input_scale.min(), scaling.output_scale.min()) <= 0:
        return f"scales {scaling.input_scale} and {scaling.output_scale}, which are not positive"
    largest = LARGEST_OUTPUT * scaling.output_scale.max()
    if not all(0 <= threshold <= largest for threshold in (model.zero.contact_N, model.zero.bin_N)):
        return f"thresholds of {model.zero.contact_N:g} and {model.zero.bin_N:g} N"
    if model.check and not 0 < model.check.share < np.inf:
        return f"a share of {model.check.share:g} by which totals may differ"
    for ending in ("half_N", "sigma_N", "singular"):
        if any(values.min(initial=0) < 0 for name, values in numbers.items() if name.endswith(ending)):
            return f"a number of {ending} is negative"
    weights = (values for name, values in numbers.items() if name.startswith("weights"))
    reach = max(np.abs(values).max(initial=0) for values in weights)
    with torch.inference_mode():
        count = len(scaling.input_mean) + (scaling.output_mean.size if model.reads_inverse else 0)
        signs = torch.tensor([[1.0], [-1.0]]).expand(-1, count)
        reach = max(reach, model.network(signs).abs().max().item())
    if not reach <= LARGEST_OUTPUT:
        return f"a weight or an output is {reach:.3g} times the usual, limit {LARGEST_OUTPUT:g}"
    size = float(np.abs(scaling.output_mean).max() / scaling.output_scale.max())
    if size > LARGEST_OUTPUT:
        return f"a mean label is {size:.3g} times the labels' standard deviation, limit {LARGEST_OUTPUT:g}"
    return ""


def _model_from(content: dict) -> Model:
    settings = content["settings"]
    scaling = Scaling(**_arrays(content["scaling"]))
    bins = settings["bins"]
    grids = Grids(settings["features"]["regions"], bins["nx"], bins["ny"])
    network = make_network(Learning.model_validate(settings["learning"]), grids, seed=0)
    network.load_state_dict(content["weights"])
    network.eval()
    parts: dict[str, Any] = {
        name: kind(**_arrays(content[name])) for name, kind in PARTS.items() if content[name]
    }
    model = Model(network, scaling, settings, **parts)
    if model.inverse is None and model.reads_inverse:
        raise ValueError("a network that reads the inverse, without it")
    return model
