"""Which extra of the installation brings a package that a command needs and does not find."""

from __future__ import annotations

from importlib.util import find_spec

EXTRAS = {  # modules that commands import or run, by extra of pyproject.toml
    "workflow": ("snakemake", "psutil"),
    "learning": ("torch", "sklearn"),
    "live": ("websockets", "onnxruntime"),
    "bags": ("rosbags",),
    "export": ("onnx", "onnxscript", "pyarrow", "mcap"),
}


ONNX = ("torch", "onnx", "onnxscript", "onnxruntime")  # what learning.onnx needs


def missing_for_onnx() -> str | None:
    """Return one line that says what learning.onnx lacks and the command that installs it; None where all is there."""
    missing = [name for name in ONNX if find_spec(name) is None]
    if not missing:
        return None
    return (
        f'learning.onnx: true needs {", ".join(missing)}, not installed; it comes with: pip install "gelforge[export]"; '
        "or set learning.onnx: false"
    )


def missing_extra(error: ImportError) -> str | None:
    """Return one line that names the package that is missing and the command that installs it.

    None for a package that no extra brings: then the installation itself is broken, and the traceback says where.
    """
    package = (error.name or "").partition(".")[0]
    for extra, brings in EXTRAS.items():
        if package in brings:
            return f'{package} is not installed; it comes with: pip install "gelforge[{extra}]"'
    return None
