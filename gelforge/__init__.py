"""gelforge: force-distribution labels, datasets and models for soft, vision-based tactile sensors."""

__version__ = "0.1.0"


def load_dataset(folder, split=None, columns=None, images=False):
    """Return the rows of a dataset as PyTorch datasets by split, or that of one split; see `gelforge.learning.rows`."""
    from gelforge.learning.rows import load_dataset

    return load_dataset(folder, split, columns, images)
