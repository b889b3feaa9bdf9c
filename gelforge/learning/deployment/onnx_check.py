"""What a comparison of ONNX Runtime with PyTorch found, and the file that keeps it; needs neither of the two."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from gelforge.files import write_json
from gelforge.learning.basis.scaling import ModelError

FORMAT = "gelforge-onnx-check-1"


@dataclass(frozen=True)
class Difference:
    """The largest difference of one output, as a share, and its limit."""

    output: str
    share: float
    limit: float
    of: str  # what it is a share of

    def __str__(self) -> str:
        return f"{self.output} by {self.share:.1e} of {self.of}, limit {self.limit:g}"

    @property
    def within(self) -> bool:
        return self.share <= self.limit


@dataclass(frozen=True)
class OnnxCheck:
    """Forces of held-out images by ONNX Runtime against those by PyTorch."""

    model_sha256: str  # of model.pt
    session: str
    images: int  # compared
    sites: int  # that they show
    touched: int  # images with a predicted force
    largest_N: float  # largest force of a bin among them
    largest_difference_N: float
    outputs: tuple[Difference, ...]


def write_check(path: str | Path, check: OnnxCheck) -> None:
    """Write a comparison as JSON."""
    write_json(path, {"format": FORMAT, **asdict(check)})


def read_check(path: str | Path) -> OnnxCheck:
    """Return the comparison that `write_check` wrote. Raises ModelError for another file."""
    remedy = f"compare again (snakemake -R {path})"
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        if content.pop("format") != FORMAT:
            raise ValueError("another format")
        outputs = tuple(Difference(**output) for output in content.pop("outputs"))
        return OnnxCheck(**content, outputs=outputs)
    except FileNotFoundError:
        raise ModelError(f"{path}: no such file; {remedy}") from None
    except (AttributeError, KeyError, TypeError, ValueError):
        raise ModelError(f"{path}: not a comparison of format {FORMAT!r}; {remedy}") from None
