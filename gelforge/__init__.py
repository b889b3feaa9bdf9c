"""gelforge: force-distribution labels, datasets and models for soft, vision-based tactile sensors.

    import gelforge as gf
    answer = gf.press(16.0, 16.0, [0.5, 1.0])  # the article's sensor; forces per node and bin, with error bars

What `__all__` names is the public interface, imported when it is first used; nothing else is promised.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gelforge.api import Pressed, Slopes, press
    from gelforge.cli.notebook import require, run
    from gelforge.differentiable import PressSlopes, press_slopes
    from gelforge.learning.rows import load_dataset
    from gelforge.learning.torch_press import TorchForces, torch_press

__version__ = "0.1.0"
__all__ = [
    "PressSlopes",
    "Pressed",
    "Slopes",
    "TorchForces",
    "load_dataset",
    "press",
    "press_slopes",
    "require",
    "run",
    "torch_press",
]

_DEFINED_IN = {
    "PressSlopes": "gelforge.differentiable",
    "Pressed": "gelforge.api",
    "Slopes": "gelforge.api",
    "TorchForces": "gelforge.learning.torch_press",
    "load_dataset": "gelforge.learning.rows",
    "press": "gelforge.api",
    "press_slopes": "gelforge.differentiable",
    "require": "gelforge.cli.notebook",
    "run": "gelforge.cli.notebook",
    "torch_press": "gelforge.learning.torch_press",
}


def __getattr__(name: str):
    if name not in _DEFINED_IN:
        raise AttributeError(f"module 'gelforge' has no attribute {name!r}")
    return getattr(import_module(_DEFINED_IN[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
