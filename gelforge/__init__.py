"""gelforge: force-distribution labels, datasets and models for soft, vision-based tactile sensors."""

__version__ = "0.1.0"
