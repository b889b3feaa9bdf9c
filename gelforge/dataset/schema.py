"""What a shard holds: names, types, units and descriptions of its datasets."""

from __future__ import annotations

from dataclasses import dataclass

FORMAT = "gelforge-shard-2"


class DatasetError(ValueError):
    """A dataset that cannot be made or read: file or name, what was found, what to do."""


@dataclass(frozen=True)
class Column:
    """One dataset of a shard; axis 0 is the sample (N)."""

    shape: tuple[str, ...]  # axes after the first, by symbol: F features, B surface bins, or a number
    kind: str  # "f4", "f8", "i4", "bool" or "text"
    unit: str
    description: str
    recorded: bool  # True: only where there are images

    def sizes(self, features: int, bins: int) -> tuple[int, ...]:
        """Return the axes after the first as numbers."""
        return tuple({"F": features, "B": bins}.get(axis) or int(axis) for axis in self.shape)


COLUMNS = {
    "feature": Column(
        ("F",),
        "f4",
        "px, rad",
        "m mean flow magnitudes [px], then m directions [rad in (-pi, pi], u right, v down, 0 where nothing moved]; "
        "regions row by row from the image's top left",
        True,
    ),
    "force_distribution_N": Column(
        ("B", "3"),
        "f4",
        "N",
        "label: force on the sensor per bin of the undeformed surface, k = nx iy + ix",
        False,
    ),
    "force_sigma_N": Column(
        ("B", "3"),
        "f4",
        "N",
        "standard deviation of force_distribution_N: discretisation and constitutive models; NaN where sites have no error"
        " bars",
        False,
    ),
    "total_force_fem_N": Column(
        ("3",), "f8", "N", "total force on the sensor of the finite-element model", False
    ),
    "total_force_fem_sigma_N": Column(
        ("3",), "f8", "N", "standard deviation of total_force_fem_N, as force_sigma_N", False
    ),
    "total_force_ft_N": Column(
        ("3",),
        "f8",
        "N",
        "measured force on the sensor, sensor frame, zero subtracted; NaN where a test of the session excluded it",
        True,
    ),
    "flow_lost": Column(
        (),
        "f4",
        "1",
        "share of the textured pixels whose flow does not fit the image; beyond 0.02 features are no displacements",
        True,
    ),
    "position_mm": Column(("2",), "f8", "mm", "planned position x, y in the sensor frame", False),
    "depth_mm": Column((), "f8", "mm", "planned depth; 0 for untouched rows", False),
    "phase": Column(
        (),
        "text",
        "1",
        "zero before contact, else load, shear, tilt, dwell or unload: the step of the path",
        False,
    ),
    "cell": Column((), "text", "1", "site of the plan: one position with all its depths", False),
    "press": Column((), "text", "1", "indentation of the session", True),
    "image_index": Column((), "i4", "1", "number of the image within its indentation, from 0", True),
    "image": Column((), "text", "1", "file name of the image in the session's folder images", True),
    "session": Column((), "text", "1", "recording session", True),
    "split": Column((), "text", "1", "train or test, by orbit: a site with its mirror images", False),
    "untouched": Column((), "bool", "1", "true: recorded before contact; the label is zero", False),
}


def columns(labels_only: bool) -> dict[str, Column]:
    """Return the columns of a shard.

    Parameters
    ----------
    labels_only : bool
        Leave out columns that need images.

    Returns
    -------
    dict of str to Column
        Shape, type, unit and description by name.
    """
    return {name: column for name, column in COLUMNS.items() if not (labels_only and column.recorded)}
