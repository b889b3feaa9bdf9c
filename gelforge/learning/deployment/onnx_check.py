"""What a comparison of ONNX Runtime with PyTorch found, and the file that keeps it; needs neither of the two."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path

from gelforge.files import write_json

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
    """Write the comparison of ONNX Runtime with PyTorch as JSON.

    Parameters
    ----------
    path : str or Path
        The file.
    check : OnnxCheck
        Images compared, largest difference [N], and each output's share of its limit.

    Raises
    ------
    FileError
        For a full disk; what was there before stays.
    """
    write_json(path, {"format": FORMAT, **asdict(check)})
