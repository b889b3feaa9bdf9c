"""Sites whose label is made from that of others, mirrored or interpolated: made in bulk, as one takes milliseconds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gelforge.indentation.paths.planned_cell import PlannedCell


def derived_chunks(cells: Mapping[str, PlannedCell], per_shard: int) -> dict[int, list[str]]:
    """Return the derived sites that each job makes.

    A job makes those of whole shards of the dataset, of one where no site is interpolated. A site that is made again
    brings those of its job with it, and these are of shards that are built again anyway.

    Parameters
    ----------
    cells : mapping of str to PlannedCell
        Sites of the plan, in order.
    per_shard : int
        Sites of a shard.

    Returns
    -------
    dict of int to list of str
        Names by the number of the job.
    """
    # one job reads every solved site: it makes 256 interpolated sites
    shards = -(-256 // per_shard) if any(cell.between for cell in cells.values()) else 1
    size, names = shards * per_shard, list(cells)
    chunks = [names[first : first + size] for first in range(0, len(names), size)]
    derived = [[name for name in chunk if not cells[name].solved] for chunk in chunks]
    return {number: chunk for number, chunk in enumerate(derived) if chunk}
