"""Which forces a dataset's labels span."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.dataset.schema import DatasetError
from gelforge.dataset.shard import ShardDataset

LABEL = "force_distribution_N"


def label_ranges(shards: Sequence[str | Path]) -> np.ndarray:
    """Return the least and greatest true force of all rows.

    Parameters
    ----------
    shards : sequence of str or Path
        All shards of a dataset.

    Returns
    -------
    numpy.ndarray
        (2, 2, 3) [N]: of a bin and in total; least and greatest; x, y, z.

    Raises
    ------
    DatasetError
        Where no row has a label.
    """
    low, high = np.full((2, 3), np.inf), np.full((2, 3), -np.inf)
    for block in ShardDataset(shards).batches((LABEL,)):
        label = block[LABEL].astype(float)
        total = label.sum(axis=1)
        low = np.minimum(low, [label.min(axis=(0, 1)), total.min(axis=0)])
        high = np.maximum(high, [label.max(axis=(0, 1)), total.max(axis=0)])
    if not np.isfinite(low).all():
        raise DatasetError(
            "no label at all; every site of the study failed, see the shards' attribute failed_cells"
        )
    return np.stack([low, high], axis=1)


def force_ranges_table(ranges: np.ndarray) -> pd.DataFrame:
    """Return the ranges of the forces as a table (Sferrazza et al. 2019, table 4).

    Parameters
    ----------
    ranges : numpy.ndarray
        (2, 2, 3) [N], as `label_ranges` returns them.

    Returns
    -------
    pandas.DataFrame
        A row for the force per bin and one for the total force [N].
    """
    columns = [f"{axis}_{end}_N" for axis in "xyz" for end in ("min", "max")]
    rows = [(name, *ranges[i].T.ravel()) for i, name in enumerate(("force per bin", "total force"))]
    return pd.DataFrame(rows, columns=["quantity", *columns])
