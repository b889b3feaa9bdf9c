"""`gelforge export`: a trained model, or a finished dataset, for others to use."""

from __future__ import annotations

from pathlib import Path

from gelforge.config import ConfigError, load_study
from gelforge.learning.basis.scaling import ModelError


def export_model(model: Path | None = None, out: Path | None = None, study: Path | None = None) -> None:
    """Write a model as an ONNX file, next to it where no other place is given, and say how near PyTorch it is."""
    from gelforge.learning.deployment.onnx_export import OPSET, export_onnx

    if model is None:
        if study is None:
            raise ModelError("export needs --study or --model; for a dataset: gelforge export dataset --help")
        model = load_study(study).results_folder / "model" / "model.pt"
    out = out or model.with_suffix(".onnx")
    if out.suffix.lower() != ".onnx":
        raise ModelError(f"--out {out}: a name that ends in .onnx is expected")
    found = export_onnx(model, out)
    print(f"written to {out}: ONNX, opset {OPSET}, features [px, rad] to forces of the bins [N]")
    for difference in found:
        print(f"differs from PyTorch in {difference}")


def onnx_check(study: Path, model: Path, out: Path) -> None:
    """Compare ONNX Runtime with PyTorch on held-out images of the first session that has some, and write what was found."""
    from gelforge.cli.products import feature_path, image_sessions, session_of
    from gelforge.learning.deployment.held_out import check_held_out, held_out
    from gelforge.learning.deployment.onnx_check import write_check
    from gelforge.learning.judging.predictions import Predictions

    described = load_study(study)
    predictions = Predictions(described.results_folder / "model" / "predictions.h5")
    predictions.check_model(described.results_folder / "model" / "model.pt")
    sessions = image_sessions(described)
    every = (held_out(predictions, name, feature_path(described, name)) for name in sessions)
    known = next(filter(None, every), None)
    if known is None:
        raise ModelError(f"{predictions.path}: no prediction of an image of sessions {', '.join(sessions)}")
    folder, session = described.session_folder(known.session), session_of(described, known.session)
    check = check_held_out(model, known, predictions.model_sha256, folder, session)
    write_check(out, check)
    shown = f"{check.images} images of {check.sites} held-out sites, {check.touched} of them touched"
    print(f"session {check.session}: {shown}")
    for output in check.outputs:
        print(f"ONNX Runtime differs from PyTorch in {output}")


def export_dataset(
    form: str,
    study: Path | None,
    results: Path | None,
    out: Path,
    images: bool,
    sample_mb: float | None,
    fps: float,
    licence: str | None,
    published: str | None,
) -> None:
    """Write a study's dataset in another format, and say what was written."""
    from gelforge.dataset.exports import format_of
    from gelforge.dataset.exports.export import Options, export_dataset
    from gelforge.dataset.exports.source import open_source

    data: Path | None = None
    fraction: float | None = None
    if study:
        described = load_study(study)
        folder, data = described.results_folder / "dataset", described.data_folder
        fraction = described.learning.validation_fraction
    elif results:
        folder = results if (results / "manifest.json").is_file() else results / "dataset"
    else:
        raise ConfigError("no dataset is named; give --study or --results")
    source = open_source(folder, images, data, fraction)
    if sample_mb is not None:
        source = source.sampled(sample_mb)
    size = export_dataset(format_of(form), source, out, Options(fps, licence, published), sample_mb)
    rows = ", ".join(f"{count} {split}" for split, count in source.counts.items())
    print(f"written to {out}: {rows} rows, {size / 1e6:.1f} MB")
    if source.manifest["synthetic"]:
        print("SYNTHETIC: a virtual lab made the recordings; the card says so")
