"""Physics with a free form: maps that no single amount describes, weighed as a discrepancy is.

A module is a manner (unknown.py) whose directions are changes by a cause: the modulus of the body from place to place, an
error of the depth over the plane, a force sensor that reads what it is loaded with by its place, or by the time. Each is a
smooth random function with the plausible width of the catalogue's effect of one value that it generalises.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from gelforge.config import Study
from gelforge.indentation.effects.catalogue import with_keys
from gelforge.indentation.solving.sensitivities import unmirrored
from gelforge.mismatch.effects import CATALOGUE
from gelforge.mismatch.evidence.screen import Candidate
from gelforge.mismatch.model.context import Context
from gelforge.mismatch.model.effect import Effect
from gelforge.mismatch.model.solver_effects import per_depth
from gelforge.mismatch.terms.body_map import LEVELS, WIDTH, box_at
from gelforge.mismatch.terms.unknown import MODES, Manner, modes, of_each, product

AXES = "xyz"
OWN = 0.5  # of what all axes' gains share, by which each departs from it: wiring and amplifier are common (judgement)
LEAST_FACTOR = 0.05  # of a box's modulus in a patched study: the linear map knows no bound at none


@dataclass(frozen=True, eq=False, kw_only=True)
class Module(Manner):
    """A cause with a free form: directions, and the map that its coefficients describe."""

    name: str
    says: str  # the cause, in words that follow "; "
    map: pd.DataFrame  # (G) rows of module.csv: quantity, and place or time
    basis: np.ndarray  # (G, q) the map per unit coefficient
    unit: str
    of_labels: bool  # simulated forces change by it; else only what a force sensor reads
    to_study: Callable[[Study, np.ndarray], Study] | None = None  # with a map (G,) of it
    tells: bool = True  # no other cause that is known changes the readings in such a manner
    instead: str = ""  # words of the manner of unknown.py that is this cause without its name

    @property
    def effect(self) -> Effect:
        """Return the map as an effect of the finite elements: its amounts are the map (G,)."""
        to_study = self.to_study
        assert to_study is not None, "asked for only where a study can have the map"
        return Effect(
            self.name,
            "material",
            (),
            enters="geometry.patches",
            signature=self.words,
            confused_with=(),
            separated_by="",
            to_study=lambda study, shape, amounts: to_study(study, np.asarray(amounts)),
        )

    def values(self, mean: np.ndarray, covariance: np.ndarray) -> pd.DataFrame:
        """Return the rows of module.csv: the map with columns mean and sigma, of coefficients (q,) and (q, q)."""
        sigma = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", self.basis, covariance, self.basis), 0.0))
        return self.map.assign(unit=self.unit, mean=self.basis @ mean, sigma=sigma)


def modules_of(context: Context, boxes: Sequence[Candidate]) -> tuple[Module, ...]:
    """Return the modules that these readings may show; boxes: linear changes by the modulus of those that they can show."""
    table = context.observations.table
    found = []
    if boxes:
        found.append(modulus_map(boxes))
    if table[["x_mm", "y_mm"]].drop_duplicates().shape[0] > 1:
        found += [depth_map(context), force_map(context)]
    if any(len(rows["order"].unique()) > 1 for _, rows in table.groupby("session")):
        found.append(gain_in_time(context))
    return tuple(found)


def modulus_map(boxes: Sequence[Candidate]) -> Module:
    """Return the modulus of the body as a smooth function of place; each box's relative change by itself is WIDTH."""
    at = pd.DataFrame([dict(box.shape) for box in boxes])
    basis = WIDTH * product(plane_modes(at), modes(at["z_mm"].to_numpy(float), LEVELS))
    return Module(
        words="the body's modulus from place to place",
        directions=np.column_stack([box.columns for box in boxes]) @ basis,
        name="modulus_map",
        says="the body's modulus differs from place to place",
        map=at.assign(quantity="modulus"),
        basis=basis,
        unit="1",
        of_labels=True,
        to_study=lambda study, change: _with_modulus(study, at, change),
    )


def _with_modulus(study: Study, at: pd.DataFrame, change: np.ndarray) -> Study:
    """Return the study with the boxes' relative changes (G,) of modulus."""
    geometry = study.mechanics.effects.geometry
    others = [patch.model_dump() for patch in geometry.patches]
    own = [
        box_at(study, shape) | {"factor": float(max(1 + a, LEAST_FACTOR))}
        for shape, a in zip(at.to_dict("records"), change)
    ]
    return with_keys(unmirrored(study), geometry={"patches": [*others, *own]})


def depth_map(context: Context) -> Module:
    """Return an error of the depth [mm] as a smooth function of the stage's place."""
    (deeper,) = CATALOGUE["contact_zero"].parameters
    table = context.observations.table
    at, rows = _sites(table)
    basis = deeper.width * plane_modes(table)
    flat = context.observations.flat
    return Module(
        words="the depth reached from place to place",
        directions=flat(per_depth(context)[:, :, None] * basis[:, None, :]),
        name="depth_map",
        says="the depth that is reached differs from place to place",
        map=at.assign(quantity="depth"),
        basis=basis[rows],
        unit="mm",
        of_labels=True,
    )


def force_map(context: Context) -> Module:
    """Return gain and cross-talk of the force sensor, each as a smooth function of the place that is loaded."""
    table, force = context.observations.table, context.force
    at, rows = _sites(table)
    plane = plane_modes(table)
    directions, basis, maps = [], [], []
    for i in range(3):
        for j in range(3):
            own = (CATALOGUE["force_gain" if i == j else "cross_talk"].parameters[0].width) * plane
            change = np.zeros((len(table), 3, plane.shape[1]))
            change[:, i] = force[:, [j]] * own
            directions.append(context.observations.flat(change))
            basis.append(own[rows])
            maps.append(at.assign(quantity=f"gain {AXES[i]}" if i == j else f"{AXES[i]} of {AXES[j]}"))
    return Module(
        words="what the force sensor reads from place to place",
        directions=np.column_stack(directions),
        name="force_map",
        says="the force sensor's gain and cross-talk depend on where it is loaded",
        map=pd.concat(maps, ignore_index=True),
        basis=_blocks(basis),
        unit="1",
        of_labels=False,
        tells=False,  # a moved grid, or layers of other thickness, do the same: a gain that depends on the place is none
    )


def gain_in_time(context: Context) -> Module:
    """Return the force sensor's gain over each session's time: a part that all axes share, and their own."""
    table = context.observations.table
    width = CATALOGUE["force_gain"].parameters[0].width
    time = width * of_each(table["session"].to_numpy(), table["order"].to_numpy(float), MODES["time"])
    presses = table.drop_duplicates("press")
    flat, shared = context.observations.flat, context.force[:, :, None] * time[:, None, :]
    own = [flat(shared * OWN * (np.arange(3) == k)[None, :, None]) for k in range(3)]
    at = presses[["session", "order", "time_s"]].reset_index(drop=True)
    basis = time[presses.index]
    return Module(
        words="the force sensor's gain over the session's time",
        directions=np.column_stack([flat(shared), *own]),
        name="gain_in_time",
        says="the force sensor's gain, or the stiffness of all layers (forces alone do not distinguish them), changes over"
        " the session",
        map=pd.concat([at.assign(quantity=f"gain {axis}") for axis in AXES], ignore_index=True),
        basis=np.column_stack([np.tile(basis, (3, 1)), OWN * _blocks([basis] * 3)]),
        unit="1",
        of_labels=False,
        instead="all forces in proportion over the session's time",
    )


def plane_modes(at: pd.DataFrame) -> np.ndarray:
    """Return cosines (n, q) over the plane, of mean square 1 together, at places x_mm, y_mm."""
    x, y = (modes(at[name].to_numpy(float), MODES["place"]) for name in ("x_mm", "y_mm"))
    return product(x, y)


def _sites(table: pd.DataFrame) -> tuple[pd.DataFrame, np.ndarray]:
    """Return the places x_mm, y_mm of the readings, and the number of the first reading at each."""
    first = table.drop_duplicates(["x_mm", "y_mm"])
    return first[["x_mm", "y_mm"]].reset_index(drop=True), first.index.to_numpy()


def _blocks(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Return matrices (g, q) along a diagonal."""
    rows = sum(len(part) for part in parts)
    found, row, column = np.zeros((rows, sum(part.shape[1] for part in parts))), 0, 0
    for part in parts:
        found[row : row + len(part), column : column + part.shape[1]] = part
        row, column = row + len(part), column + part.shape[1]
    return found
