"""A recording as a laboratory hands it over: the force sensor's noise and steps, sessions in the documented format."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import DepthZero, ForceSensor, Session, write_yaml

from .sensors import SMALL, Sensor
from .world import World, held, zeroed

FORCE = ["fx_N", "fy_N", "fz_N"]
COLUMNS = [
    "press",
    "cell",
    "order",
    "time_s",
    "phase",
    "x_mm",
    "y_mm",
    "depth_mm",
    "speed_mm_per_s",
    "dwell_s",
    *FORCE,
    "image",
]
STAGE_MM = (0.004, 0.012)  # repeatability of stages, drawn evenly
FLOOR = (
    0.001,
    0.001,
    0.005,
)  # of Fz, x, y, z: what base and fine mesh differ by, at the middle and between places
README = """SYNTHETIC session {session}: made by FElupe for the proof on concealed effects, not measured.
"""


@dataclass(frozen=True)
class Instrument:
    """The recording's own errors, which its session states."""

    noise_N: tuple[float, float, float]
    step_N: float
    tails: bool  # Student's t with 5 degrees of freedom, of the same standard deviation
    zero_drift_N_per_s: float  # of an untared zero, taken off by every press's zero rows
    touchdown_mm: float
    zero_by: str  # press or session
    tared: bool
    ages_days: tuple[float, ...]
    temperatures_C: tuple[float, ...]
    stage_mm: float = 0.0  # from press to press, next to the session's contact point

    @property
    def sigma_N(self) -> np.ndarray:
        """Return the standard deviation (3,) of one reading, steps included."""
        return np.sqrt(np.square(self.noise_N) + self.step_N**2 / 12)


def drawn_instrument(
    rng: np.random.Generator, sessions: int = 1, zero_by: str | None = None, tared: bool | None = None
):
    """Return an instrument at random: what an effect needs of it is given, the rest is drawn for all cases alike."""
    z = float(rng.uniform(0.003, 0.008))
    by = str(rng.choice(["press", "session"]))
    of_itself = bool(rng.random() < 0.3)
    instrument = Instrument(
        noise_N=(z / 2, z / 2, z),
        step_N=float(rng.choice([0.001, 0.002, 0.01], p=[0.4, 0.4, 0.2])),
        tails=bool(rng.random() < 0.25),
        zero_drift_N_per_s=float(rng.normal(0, 2e-5)) * bool(rng.random() < 0.3),
        touchdown_mm=float(rng.uniform(0.005, 0.02)),
        zero_by=by,
        tared=of_itself,
        ages_days=tuple(float(a) for a in (5.0, 35.0)[:sessions]),
        temperatures_C=tuple(float(t) for t in (21.0, 26.0)[:sessions]),
    )
    if zero_by:
        instrument = replace(instrument, zero_by=zero_by)
    if instrument.zero_by == "session":  # of a stream of its own: the others' draws stay as they were
        (stage,) = rng.spawn(1)
        instrument = replace(
            instrument, stage_mm=float(stage.uniform(*STAGE_MM)) * bool(stage.random() < 0.5)
        )
    if tared is not None:
        instrument = replace(instrument, tared=tared)
    return replace(instrument, zero_drift_N_per_s=0.0) if instrument.tared else instrument


def with_circumstances(rows: pd.DataFrame, instrument: Instrument) -> pd.DataFrame:
    """Return the rows with the age and temperature of their session."""
    session = rows["session"].to_numpy()
    return rows.assign(
        age=np.array(instrument.ages_days)[session], temperature=np.array(instrument.temperatures_C)[session]
    )


def contact_point_error(rows: pd.DataFrame, instrument: Instrument, rng: np.random.Generator) -> np.ndarray:
    """Return by how much each reading is pressed deeper (R,) [mm]: draws of each press, of each session, or of both."""
    deeper = np.zeros(len(rows))
    (stage,) = rng.spawn(1)
    for (keys, size), draws in zip(depth_errors(instrument), (rng, stage)):
        group = rows.groupby(keys, sort=False).ngroup().to_numpy()
        deeper += draws.normal(0, size, group.max() + 1)[group]
    return deeper


def depth_errors(instrument: Instrument) -> list[tuple[list[str], float]]:
    """Return the errors of the depth: the columns whose rows share a draw, and its standard deviation [mm]."""
    by_press, by_session = ["session", "order"], ["session"]
    found = [(by_press if instrument.zero_by == "press" else by_session, instrument.touchdown_mm)]
    return found + [(by_press, instrument.stage_mm)] * (instrument.stage_mm > 0)


def recorded(
    world: World, rows: pd.DataFrame, instrument: Instrument, rng: np.random.Generator
) -> np.ndarray:
    """Return the readings (R, 3) [N] as written: the world's forces with depth errors, untared zero, noise and steps."""
    force = world.forces(rows, contact_point_error(rows, instrument, rng))
    offset = np.zeros(3) if instrument.tared else rng.normal(0, 0.1, 3)
    force = force + offset + instrument.zero_drift_N_per_s * rows["time_s"].to_numpy()[:, None]
    noise = (
        rng.standard_t(5, force.shape) * np.sqrt(3 / 5) if instrument.tails else rng.normal(size=force.shape)
    )
    noisy = force + noise * np.array(instrument.noise_N)
    return np.round(np.rint(noisy / instrument.step_N) * instrument.step_N, 6) + 0.0


def signal_to_noise(
    world: World,
    rows: pd.DataFrame,
    instrument: Instrument,
    change: np.ndarray,
    floor: bool = True,
    doubts: Sequence[np.ndarray] = (),
) -> float:
    """Return sqrt(d' C^-1 d) of a change (R, 3) of the zeroed forces of readings under load; C as in `products`."""
    return float(np.sqrt(max(products(world, rows, instrument, [change], floor, doubts)[0, 0], 0.0)))


def products(
    world: World,
    rows: pd.DataFrame,
    instrument: Instrument,
    changes: Sequence[np.ndarray],
    floor: bool = True,
    doubts: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return D' C^-1 D (K, K) of K changes (R, 3) of the zeroed forces of readings under load.

    C: noise and steps, the zero subtracted from each press, errors of the depth at the base's slope, and
    the floor of discretisation: FLOOR of Fz, half of its variance common to all places and half each place's own; and
    what one standard deviation of each doubtful constant changes, doubts (R, 3) [N].
    """
    on = held(rows)
    part = rows[on]
    slope = (world.forces(rows, 0.005) - world.forces(rows, -0.005))[on] / 0.01
    sigma = np.tile(instrument.sigma_N, on.sum())
    columns = [_per_group(part, keys, slope) * size for keys, size in depth_errors(instrument)]
    if not instrument.tared:
        for axis in range(3):
            unit = np.zeros((on.sum(), 3))
            unit[:, axis] = instrument.sigma_N[axis] / np.sqrt(3)
            columns.append(_per_group(part, ["session", "order"], unit))
    if floor:
        pattern = np.abs(world.forces(rows)[on, 2:]) * FLOOR / np.sqrt(2)
        columns += [pattern.reshape(-1, 1), _per_group(part, ["x_mm", "y_mm"], pattern)]
    columns += [doubt[on].reshape(-1, 1) for doubt in doubts]
    L = np.hstack(columns) / sigma[:, None]
    D = np.stack([change[on].ravel() / sigma for change in changes], axis=1)
    inner = np.eye(L.shape[1]) + L.T @ L
    return D.T @ D - (L.T @ D).T @ np.linalg.solve(inner, L.T @ D)


def _per_group(rows, keys, values) -> np.ndarray:
    """Return values (R, 3) as columns (3 R, groups), each group's own."""
    group = rows.groupby(keys, sort=False).ngroup().to_numpy()
    columns = np.zeros((len(rows), 3, group.max() + 1))
    columns[np.arange(len(rows)), :, group] = values
    return columns.reshape(3 * len(rows), -1)


def change_of(base: World, world: World, rows: pd.DataFrame, tared: bool) -> np.ndarray:
    """Return what a world changes (R, 3) [N] of the base's forces, zero subtracted."""
    return zeroed(rows, world.forces(rows), tared) - zeroed(rows, base.forces(rows), tared)


def write_recording(
    folder: Path,
    name: str,
    rows: pd.DataFrame,
    readings: np.ndarray,
    instrument: Instrument,
    sensor: Sensor = SMALL,
    exact: bool = True,
) -> list[Path]:
    """Write the sessions of a recording under folder/recordings and return their folders.

    exact: whether the sessions say that the constants of the constitutive models are certain.
    """
    folders = []
    for number, part in rows.groupby("session", sort=False):
        session = f"{name}_{chr(ord('a') + number)}"
        out = folder / "recordings" / session
        out.mkdir(parents=True, exist_ok=True)
        table = part.assign(speed_mm_per_s=part["speed"].abs(), image="")
        table[["x_mm", "y_mm"]] = part[["x_mm", "y_mm"]] + sensor.middle
        table[FORCE] = readings[part.index]
        text = table[COLUMNS].round(6).to_csv(index=False, lineterminator="\n")
        (out / "indentations.csv").write_text(text, encoding="utf-8")
        (out / "README.txt").write_text(README.format(session=session), encoding="utf-8")
        write_yaml(out / "session.yaml", _session(session, instrument, number, sensor, exact))
        folders.append(out)
    return folders


def _session(name: str, instrument: Instrument, number: int, sensor: Sensor, exact: bool) -> Session:
    return Session(
        session=name,
        synthetic=True,
        sensor="concealed" if sensor == SMALL else sensor.name,
        indenter=f"ball of radius {sensor.plain.radius_mm:g} mm",
        notes="SYNTHETIC: made by FElupe with effects that are not told",
        temperature_C=instrument.temperatures_C[number],
        sensor_age_days=instrument.ages_days[number],
        force=ForceSensor(
            tared=instrument.tared,
            resolution_N=[instrument.step_N] * 3,
            repeatability_N=[round(float(sigma), 6) for sigma in instrument.sigma_N],
        ),
        depth_zero=_depth_zero(instrument),
        base_parameters="exact" if exact else "from_fit",
    )


def _depth_zero(instrument: Instrument) -> DepthZero:
    sizes = {"press": instrument.stage_mm, "session": 0.0}
    sizes[instrument.zero_by] = instrument.touchdown_mm
    scatter = {f"{by}_scatter_mm": round(size, 6) for by, size in sizes.items()}
    return DepthZero(by=instrument.zero_by, how="touch found by force", **scatter)


def described(instrument: Instrument) -> dict:
    return asdict(instrument)
