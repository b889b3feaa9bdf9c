"""The feedforward network of Sferrazza et al. 2019 (section V, table 2) and the scaling that travels with it."""

from __future__ import annotations

import io
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from gelforge.files import atomic, check_seal

FORMAT = "gelforge-model-1"
FORMS = ("vector", "polar")  # of Scaling
LARGEST_OUTPUT = 1e4  # in units of Scaling.output_scale; trained networks stay below some hundred
SIGMOID_GAIN = 4.0  # Glorot & Bengio 2010: a sigmoid's slope at 0 is 1/4


class ModelError(ValueError):
    """A model that cannot be made or used: file, what was found, what to do."""


def make_network(features: int, hidden: list[int], outputs: int, dropout: float, seed: int) -> nn.Sequential:
    """Return linear layers with a sigmoid and dropout after each hidden one, seeded.

    Glorot's uniform weights: gain 1 into the first layer, whose inputs have unit size, 4 between sigmoids, 1 out of the
    last. Biases start so that a sigmoid at rest (1/2) passes on zero; with PyTorch's own start the signal of three
    sigmoids in a row is some 1e-3 and training at the paper's step size begins with a long plateau.
    """
    generator = torch.Generator().manual_seed(seed)
    widths = [features, *hidden, outputs]
    layers: list[nn.Module] = []
    for number, (fan_in, fan_out) in enumerate(zip(widths, widths[1:])):
        linear = nn.Linear(fan_in, fan_out)
        between = 0 < number < len(widths) - 2
        nn.init.xavier_uniform_(linear.weight, gain=SIGMOID_GAIN if between else 1.0, generator=generator)
        with torch.no_grad():
            linear.bias.copy_(-0.5 * linear.weight.sum(dim=1) if number else torch.zeros(fan_out))
        layers.append(linear)
        if fan_out != outputs or number < len(widths) - 2:
            layers += [nn.Sigmoid(), nn.Dropout(dropout)]
    return nn.Sequential(*layers)


@dataclass(frozen=True)
class Scaling:
    """How features become inputs of unit size and outputs become newtons; measured on training rows only.

    inputs = (features - mean) / scale; where form is "vector", each region's (magnitude, direction) is first turned
    into (magnitude cos direction, magnitude sin direction), which does not jump at +-pi. scale is one number for the
    first half of the inputs and one for the second, so that regions that hardly move stay small instead of becoming
    noise of unit size. newtons = outputs * output_scale + output_mean, one scale per axis.
    """

    form: str  # "vector" or "polar"
    input_mean: np.ndarray  # (F,) float32
    input_scale: np.ndarray  # (2,) float32
    output_mean: np.ndarray  # (B, 3) float32 [N]
    output_scale: np.ndarray  # (3,) float32 [N]

    def inputs(self, feature: np.ndarray) -> np.ndarray:
        """Return network inputs (n, F) float32 of features (n, F)."""
        flow = input_flow(feature, self.form)
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


def input_flow(feature: np.ndarray, form: str) -> np.ndarray:
    """Return unscaled inputs (n, F) float32 of features (n, F): a copy, or the regions' flow components [px]."""
    if form == "polar":
        return np.array(feature, dtype=np.float32)
    half = feature.shape[-1] // 2
    flow = np.empty(feature.shape, dtype=np.float32)
    magnitude, direction = feature[..., :half], feature[..., half:]
    np.multiply(magnitude, np.cos(direction), out=flow[..., :half])
    np.multiply(magnitude, np.sin(direction), out=flow[..., half:])
    return flow


@dataclass(frozen=True)
class Model:
    """A network with its scaling, the settings it was trained with and what its features need."""

    network: nn.Sequential
    scaling: Scaling
    settings: dict  # learning, features and bins of the study, seed, digest of the dataset

    def predict(self, feature: np.ndarray) -> np.ndarray:
        """Return force distributions (n, B, 3) [N] of features (n, F)."""
        self.network.eval()
        with torch.inference_mode():
            outputs = self.network(torch.from_numpy(self.scaling.inputs(np.atleast_2d(feature)))).numpy()
        newtons = self.scaling.newtons(outputs)
        if not np.isfinite(newtons).all():
            bad = int((~np.isfinite(np.atleast_2d(feature))).sum())
            raise ModelError(f"the predicted force is not finite, {bad} features are not; check the images")
        return newtons


def save_model(path: str | Path, model: Model) -> None:
    """Write weights, scaling and settings as one file, whole or not at all; it holds tensors, numbers and text only."""
    scaling = {
        k: torch.from_numpy(v) if isinstance(v, np.ndarray) else v for k, v in asdict(model.scaling).items()
    }
    content = {
        "format": FORMAT,
        "weights": model.network.state_dict(),
        "scaling": scaling,
        "settings": model.settings,
    }
    save_tensors(path, content)


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


def check_trained_on(path: str | Path, shards_digest: str) -> None:
    """Raise ModelError for a model that was trained on other shards than those of this digest."""
    if load_model(path).settings.get("shards_digest") != shards_digest:
        raise ModelError(
            f"{path}: was trained on other shards than the study's; train the model again (snakemake -R {path})"
        )


def load_model(path: str | Path) -> Model:
    """Return a saved model, ready to predict.

    Raises ModelError naming the file for one that is damaged, or whose numbers are no trained network's.
    """
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

    Hidden units lie between 0 and 1, so no output exceeds the sum of its weights' sizes: a wrong exponent is seen there.
    """
    scaling, state = model.scaling, model.network.state_dict()
    numbers = {f"weights {name}": values.numpy() for name, values in state.items()}
    numbers |= {name: value for name, value in vars(scaling).items() if isinstance(value, np.ndarray)}
    for name, values in numbers.items():
        if not np.isfinite(values).all():
            return f"{name}: {(~np.isfinite(values)).sum()} of {values.size} numbers are not finite"
    if scaling.form not in FORMS or min(scaling.input_scale.min(), scaling.output_scale.min()) <= 0:
        return (
            f"scaling of form {scaling.form!r} with scales {scaling.input_scale} and {scaling.output_scale}"
        )
    last = model.network[-1]
    reach = (last.weight.abs().sum(dim=1) + last.bias.abs()).max().item()
    if reach > LARGEST_OUTPUT:
        return (
            f"an output can reach {reach:.3g} times the labels' standard deviation, limit {LARGEST_OUTPUT:g}"
        )
    size = float(np.abs(scaling.output_mean).max() / scaling.output_scale.max())
    if size > LARGEST_OUTPUT:
        return f"a mean label is {size:.3g} times the labels' standard deviation, limit {LARGEST_OUTPUT:g}"
    return ""


def _model_from(content: dict) -> Model:
    settings = content["settings"]
    scaling = Scaling(
        **{k: v.numpy() if isinstance(v, torch.Tensor) else v for k, v in content["scaling"].items()}
    )
    network = make_network(
        len(scaling.input_mean),
        settings["learning"]["hidden"],
        scaling.output_mean.size,
        settings["learning"]["dropout"],
        seed=0,
    )
    network.load_state_dict(content["weights"])
    network.eval()
    return Model(network, scaling, settings)
