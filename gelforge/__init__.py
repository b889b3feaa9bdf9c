"""gelforge: force-distribution labels, datasets and models for soft, vision-based tactile sensors.

    import gelforge as gf
    answer = gf.press(16.0, 16.0, [0.5, 1.0])  # the article's sensor; forces per node and bin, with error bars

What `__all__` names is the public interface, imported when it is first used; nothing else is promised.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gelforge.api.differentiable import PressSlopes, press_slopes, torch_press
    from gelforge.api.materials import Fitted, fit
    from gelforge.api.predictions import predict
    from gelforge.api.press import Pressed, Slopes, press
    from gelforge.api.recordings import judge, read_recording
    from gelforge.api.studies import indenters, load_study, sensor, sensors
    from gelforge.cli.notebook import require, run
    from gelforge.learning.basis.rows import load_dataset
    from gelforge.learning.basis.torch_press import TorchForces

__version__ = "0.1.0"

_DEFINED_IN = {
    "Fitted": "gelforge.api.materials",
    "PressSlopes": "gelforge.api.differentiable",
    "Pressed": "gelforge.api.press",
    "Slopes": "gelforge.api.press",
    "TorchForces": "gelforge.learning.basis.torch_press",
    "fit": "gelforge.api.materials",
    "indenters": "gelforge.api.studies",
    "judge": "gelforge.api.recordings",
    "load_dataset": "gelforge.learning.basis.rows",
    "load_study": "gelforge.api.studies",
    "predict": "gelforge.api.predictions",
    "press": "gelforge.api.press",
    "press_slopes": "gelforge.api.differentiable",
    "read_recording": "gelforge.api.recordings",
    "require": "gelforge.cli.notebook",
    "run": "gelforge.cli.notebook",
    "sensor": "gelforge.api.studies",
    "sensors": "gelforge.api.studies",
    "torch_press": "gelforge.api.differentiable",
}
__all__ = [
    "Fitted",
    "PressSlopes",
    "Pressed",
    "Slopes",
    "TorchForces",
    "fit",
    "indenters",
    "judge",
    "load_dataset",
    "load_study",
    "predict",
    "press",
    "press_slopes",
    "read_recording",
    "require",
    "run",
    "sensor",
    "sensors",
    "torch_press",
]


def __getattr__(name: str):
    if name not in _DEFINED_IN:
        raise AttributeError(f"module 'gelforge' has no attribute {name!r}")
    return getattr(import_module(_DEFINED_IN[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
