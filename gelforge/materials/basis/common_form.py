"""The common form of a material test: what every reader returns and every analysis takes.

A test is a load case (what was done to the material) and a history (in which order). Both axes are engineering
quantities: stretch and nominal stress, whatever the file held; Cauchy stress is derived. Compression is
uniaxial with stretch below 1 and negative stress, and is kept apart because its samples differ (cylinders, not
strips). In simple shear `stretch` is the amount of shear gamma and the stress is the nominal shear stress.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

# kind of test -> load case of the law (`mechanics.laws.homogeneous`), None where there is no such closed form
LOAD_CASE_OF = {
    "uniaxial": "uniaxial",
    "compression": "uniaxial",
    "pure_shear": "pure_shear",
    "equibiaxial": "equibiaxial",
    "biaxial": "biaxial",  # stretch_2 is given row by row
    "simple_shear": "simple_shear",
}
HISTORIES = ("monotonic", "cyclic", "relaxation")


@dataclass(frozen=True)
class Segment:
    """A part of a test, rows start..stop-1, in which the sample is loaded, unloaded or held."""

    kind: str  # "load": away from rest, "unload": back to it, "hold"
    start: int
    stop: int
    cycle: int  # counts from 1; a new one begins with each load after an unload

    @property
    def rows(self) -> slice:
        """Return the rows of the segment."""
        return slice(self.start, self.stop)


@dataclass(frozen=True)
class MaterialTest:
    """One sample's test: stretch (n,) and nominal stress (n,) [MPa] along the load, and what is known about it.

    stretch_2 and nominal_stress_2 (n,) belong to the lateral direction where it was measured.
    cauchy_difference (n,) [MPa] is sigma_1 - sigma_2 where only that was published; nominal_stress is then NaN.
    """

    test: str  # a key of LOAD_CASE_OF
    sample: str
    stretch: np.ndarray
    nominal_stress: np.ndarray
    time_s: np.ndarray | None = None
    stretch_2: np.ndarray | None = None
    nominal_stress_2: np.ndarray | None = None
    cauchy_difference: np.ndarray | None = None
    history: str = "monotonic"
    material: str = ""
    rate_per_s: float | None = None  # stretch (or shear) rate while loading
    age_days: float | None = None
    temperature_C: float | None = None
    # treatments before the test, e.g. irradiations, in the unit of whoever counted them
    dose: float | None = None
    cycle: int | None = None
    segments: tuple[Segment, ...] = ()
    findings: tuple[str, ...] = ()  # what is missing or odd, and what was corrected because it was asked for
    source: str = ""  # its file, by its path below the folder that was read

    @property
    def cauchy_stress(self) -> np.ndarray:
        """Return the stress per current area (n,) [MPa] in the loading direction of an incompressible sample."""
        if self.test == "simple_shear":
            return self.nominal_stress  # the sheared plane keeps its area
        return self.nominal_stress * self.stretch

    @property
    def abscissa(self) -> str:
        """Return what `stretch` is called in a sentence."""
        return "shear" if self.test == "simple_shear" else "stretch"

    @property
    def at_rest(self) -> float:
        """Return the value of `stretch` of the undeformed sample: 1, or 0 for the amount of shear."""
        return 0.0 if self.test == "simple_shear" else 1.0

    def part(self, rows) -> MaterialTest:
        """Return the test with only some of its rows (slice, mask or indices); segments are dropped."""
        arrays = ("stretch", "nominal_stress", "time_s", "stretch_2", "nominal_stress_2", "cauchy_difference")
        return replace(self, **_chosen(self, arrays, rows), segments=())

    def of_kind(self, kind: str, cycle: int | None = None) -> list[MaterialTest]:
        """Return the parts that load, unload or hold, of one cycle or of all; a hold's rate is 0."""
        chosen = [s for s in self.segments if s.kind == kind and cycle in (None, s.cycle)]
        return [replace(self.part(s.rows), cycle=s.cycle) for s in chosen]


HOLD_MOVES = 0.1  # of the longest way of a segment: a hold moves by creep alone


@dataclass(frozen=True)
class IndentationTest:
    """One indentation of a specimen: position along the indentation, growing with depth (its zero is unknown), and force."""

    sample: str
    position_mm: np.ndarray  # (n,)
    force_N: np.ndarray  # (n,), pushing is positive
    time_s: np.ndarray | None = None
    segment: np.ndarray | None = None  # (n,) names of the segments
    material: str = ""
    ball_radius_mm: float | None = None
    findings: tuple[str, ...] = ()
    source: str = ""
    layer_thickness_mm: float | None = None  # on a rigid base; None: half space
    rigid_board: str | None = None  # name of the file of the same indentation on a rigid board

    @property
    def is_the_board(self) -> bool:
        """Return whether this is itself the indentation on the rigid board that it names."""
        return self.rigid_board is not None and f"/{self.source}".endswith(f"/{self.rigid_board}")

    @property
    def segment_kinds(self) -> list[tuple[str, str]]:
        """Return the segments in order, each with "load", "unload" or "hold"; none where they are not named."""
        if self.segment is None:
            return []
        names = list(dict.fromkeys(self.segment))
        ways = [float(np.subtract(*self.in_segment(name).position_mm[[-1, 0]])) for name in names]
        longest = max(map(abs, ways))
        kinds = ("hold" if abs(w) < HOLD_MOVES * longest else "load" if w > 0 else "unload" for w in ways)
        return list(zip(names, kinds))

    def in_segment(self, name: str) -> IndentationTest:
        """Return the rows of one named segment."""
        if self.segment is None:
            raise ValueError(
                f"{self.source} {self.sample}: its segments have no names; {name!r} was asked for"
            )
        return replace(
            self, **_chosen(self, ("position_mm", "force_N", "time_s", "segment"), self.segment == name)
        )


def _chosen(test, arrays: tuple[str, ...], rows) -> dict[str, Any]:
    """Return rows of those arrays of a test that it has, by name."""
    return {name: getattr(test, name)[rows] for name in arrays if getattr(test, name) is not None}


@dataclass(frozen=True)
class ForcePair:
    """The same force measured by two load cells at the same instants."""

    sample: str
    force_1_N: np.ndarray  # (n,)
    force_2_N: np.ndarray  # (n,)
    time_s: np.ndarray | None = None
    position: np.ndarray | None = None  # (n,) names of where the body was pressed
    findings: tuple[str, ...] = ()
    source: str = ""
