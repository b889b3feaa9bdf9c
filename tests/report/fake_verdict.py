"""A small made-up verdict folder, SYNTHETIC, in the formats of the mismatch stage, so that its page can be drawn.

Nothing here is judged: a force of the right size, a softer gel with a little noise, and numbers that fit together.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.mismatch.result.verdict import Verdict, write_verdict
from gelforge.mismatch.result.verdict_tables import BODY_MAP, READINGS, write_tables

DEPTHS = np.arange(0.25, 2.01, 0.25)
SITES = [(x, y) for y in (5.0, 10.5, 16.0, 21.5, 27.0) for x in (5.0, 10.5, 16.0, 21.5, 27.0)]
ASIDE = {3, 6, 12, 17, 20, 24}
SIGMA = {"x": 0.008, "y": 0.008, "z": 0.02}


def base_N(x: float, y: float, depth: np.ndarray) -> dict[str, np.ndarray]:
    off = np.hypot(x - 16, y - 16) / 15.6
    fz = -0.36 * depth**1.6 * (1 + 0.34 * off**2)
    return {"x": -0.004 * (x - 16) * fz, "y": -0.004 * (y - 16) * fz, "z": fz}


def fake_readings(change: float = -0.09, after: bool = True, seed: int = 0) -> pd.DataFrame:
    """Return readings of 25 sites in two sessions whose forces are (1 + change) of the base's, loading and unloading."""
    rng, rows = np.random.default_rng(seed), []
    for number, site in enumerate(rng.permutation(len(SITES))):
        x, y = SITES[site]
        path = [("load", d) for d in DEPTHS] + [("unload", d) for d in DEPTHS[-2::-2]]
        base = base_N(x, y, np.array([depth for _, depth in path]))
        for axis, sigma in SIGMA.items():
            measured = (1 + change) * base[axis] + rng.normal(0, sigma, len(path))
            for k, (phase, depth) in enumerate(path):
                rows.append(
                    {
                        "session": "day1" if number < 15 else "day2",
                        "press": number,
                        "site": site,
                        "x_mm": x,
                        "y_mm": y,
                        "depth_mm": depth,
                        "phase": phase,
                        "time_s": 60.0 * (number % 15) + 4.0 * k,
                        "axis": axis,
                        "measured_N": measured[k],
                        "base_N": base[axis][k],
                        "after_N": (1 + change) * base[axis][k] if after else np.nan,
                        "sigma_N": sigma * (1 + 0.3 * depth),
                        "held_out": "positions" if site in ASIDE else "deepest" if depth > 1.6 else "no",
                    }
                )
    return pd.DataFrame(rows)


def fake_body_map(change: float = -0.09) -> pd.DataFrame:
    """Return 6 x 6 x 3 patches, known in the middle and hardly at the rim."""
    rng, centres = np.random.default_rng(1), (np.arange(6) + 0.5) * 32 / 6
    rows = []
    for z, known in ((-0.75, 0.5), (-3.0, 1.0), (-5.0, 0.7)):
        for y in centres:
            for x in centres:
                sigma = 0.03 / known * (1 + 2 * (np.hypot(x - 16, y - 16) / 16) ** 2)
                inside = change if z < -1.5 else 0.1 * change
                rows.append((x, y, z, inside * known + 0.4 * sigma * rng.normal(), sigma))
    return pd.DataFrame(rows, columns=["x_mm", "y_mm", "z_mm", "change", "sigma"])


def score(table: pd.DataFrame, column: str) -> dict:
    left = table["measured_N"] - table[column]
    errors = [float(np.sqrt((left[table["axis"] == axis] ** 2).mean())) for axis in "xyz"]
    return {"readings": len(table), "rmse_N": errors}


def log_score(table: pd.DataFrame, column: str) -> float:
    white = (table["measured_N"] - table[column]) / table["sigma_N"]
    return float(-0.5 * (white**2).sum() - np.log(table["sigma_N"]).sum())


def block(table: pd.DataFrame, name: str, chosen: pd.Series) -> dict:
    before, after = score(table[chosen], "base_N"), score(table[chosen], "after_N")
    gain = log_score(table[chosen], "after_N") - log_score(table[chosen], "base_N")
    return {"block": name, "before": before, "after": after, "gain": gain, "standard_error": 0.11 * abs(gain)}


def effect(name: str, family: str, probability: float, log: float, value=None, **keys) -> dict:
    """Return an effect that was tried; value: name, unit, value, interval's half width."""
    content = {
        "name": name,
        "family": family,
        "probability": probability,
        "log_bayes_factor": log,
        "in_range": True,
    }
    if value:
        label, unit, value, half = value
        content["parameters"] = [
            {"name": label, "unit": unit, "value": value, "interval_90": [value - half, value + half]}
        ]
    return content | keys


LIKE = ["gel_stiffness", "force_gain", "particle_settling"]
TRIED = [
    ("layer_thickness", "geometry", 0.006, 61.0),
    ("viscoelastic", "history", 0.004, 58.4),
    ("compressibility", "material", 0.001, 40.2),
    ("frame_compliance", "kinematics", 0.0005, 31.0),
    ("contact_zero", "kinematics", 0.0003, 22.7),
    ("tilt", "kinematics", 0.0, 4.1),
    ("friction", "contact", 0.0, 1.7),
    ("adhesion", "contact", 0.0, -0.4),
    ("void", "geometry", 0.0, -0.9),
    ("force_drift", "force sensor", 0.0, -1.2),
    ("cross_talk", "force sensor", 0.0, -1.9),
    ("camera_pose", "camera", 0.0, -2.0),
]


def fake_content() -> dict:
    """Return the content of an `identified` verdict, three effects being alike, about fake_readings()."""
    table = fake_readings()
    aside = table["held_out"] != "no"
    value = ("scale", "-", -0.09, 0.012)
    gel = effect("gel_stiffness", "material", 0.62, 66.1, value, snr=11.8, refitted=True)
    gain = effect(
        "force_gain",
        "force sensor",
        0.35,
        65.5,
        ("z", "-", -0.09, 0.013),
        snr=11.6,
        refitted=True,
    )
    settling = effect(
        "particle_settling", "geometry", 0.02, 62.6, ("share", "-", -0.11, 0.02), in_range=False
    )
    zeros = [0.0005, 0.0005, 0.002]
    return {
        "title": "SYNTHETIC presses on a made-up sensor",
        "synthetic": True,
        "state": "identified",
        "sentence": "The gel is 9 % softer than simulated or an indistinguishable cause (probability 0.97).",
        "mismatch": {
            "chi2": 1450.2,
            "degrees": len(table),
            "p": 3e-9,
            "scan_p": 0.0004,
            "unknown_p": 2e-7,
            "known_p": 3e-8,
        },
        "where": [
            {
                "words": "grows with depth",
                "channel": "force z",
                "depth_mm": [1.25, 2.0],
                "snr": 11.2,
                "p": 0.0004,
            },
            {"words": "a little more at the rim", "channel": "force z", "snr": 3.9, "p": 0.04},
        ],
        "answer": [
            {
                "members": LIKE,
                "probability": 0.97,
                "shares": dict(zip(LIKE, (0.6, 0.3, 0.1))),
                "differs_N": 0.0004,
                "differs_snr": 0.3,
                "decided_by": "Put dead weights on the sensor: they tell the force sensor's gain without the gel.",
            }
        ],
        "effects": [gel, gain, settling, *(effect(*e) for e in TRIED)],
        "unknown": {"probability": 0.02, "words": "the pressing force with depth"},
        "null_probability": 1e-6,
        "fit": {
            "before": score(table, "base_N"),
            "after": score(table, "after_N"),
            "held_out": block(table, "all", aside),
            "held_out_blocks": [
                block(table, name, table["held_out"] == name) for name in ("positions", "deepest")
            ],
        },
        "adequacy": {"p": 0.41, "scan_p": 0.22, "remains": "a wave along x"},
        "detection_limits": [
            {"effect": "gel_stiffness", "parameter": "scale", "unit": "-", "value": 0.03, "plausible": 0.1},
            {"effect": "tilt", "parameter": "about_x", "unit": "deg", "value": 0.31, "plausible": 0.5},
            {"effect": "adhesion", "parameter": "energy", "unit": "mJ/m2", "value": 90.0, "plausible": 30.0},
            {"effect": "refraction", "parameter": "index", "unit": "-", "value": None, "plausible": 0.05},
        ],
        "noise": {
            "stated_N": [0.008, 0.008, 0.02],
            "zero_N": [0.001, 0.001, 0.004],
            "press_depth_mm": 0.02,
            "floor_N": zeros,
            "law_N": [0.0, 0.0, 0.0],
        },
        "next_experiments": [
            {
                "words": "Lay three dead weights (20, 50, 100 g) on the sensor's middle and read the force",
                "separates": ["gel_stiffness", "force_gain"],
                "presses": 3,
                "cost_s": 600,
                "expected_log_odds": 14.0,
            },
            {
                "words": "Repeat 8 presses at the centre with a dwell of 60 s",
                "separates": ["gel_stiffness", "viscoelastic"],
                "presses": 8,
                "cost_s": 1500,
                "expected_log_odds": 3.1,
            },
        ],
        "cannot_know": [
            "No site was pressed twice in a session, so depth errors and a change of the sensor at a site look alike.",
            "There are no images, so nothing that only the camera sees can be known.",
        ],
        "outliers": [
            {
                "session": "day1",
                "press": "4",
                "depth_mm": 0.5,
                "axis": "x",
                "size": 7.3,
                "reason": "far from its neighbours over depth",
            }
        ],
        "sensor": {
            "width_x_mm": 32.0,
            "width_y_mm": 32.0,
            "layers": [{"name": "gel", "z_mm": [-6.0, -1.5]}, {"name": "skin", "z_mm": [-1.5, 0.0]}],
        },
        "provenance": {
            "sessions": {"day1": "a" * 64, "day2": "b" * 64},
            "base": "a made-up study, 200 converged presses",
            "base_sha256": "c" * 64,
            "seed": 5,
            "draws": 2000,
            "versions": {"gelforge": "0.0.0", "numpy": "2.0"},
        },
    }


def nothing_missing() -> dict:
    """Return the content of a `consistent` verdict: nothing was put into the base."""
    content = fake_content()
    fit = {"before": score(fake_readings(0.0), "base_N")}
    effects = [effect(e["name"], e["family"], 0.01, -2.0) for e in content["effects"]]
    mismatch = {"chi2": 830.0, "degrees": 900, "p": 0.62, "scan_p": 0.31}
    bare = {"where": [], "answer": [], "adequacy": None, "outliers": [], "next_experiments": []}
    words = (
        "The simulation explains these readings within their errors; nothing is missing that they could show."
    )
    more = {
        "fit": fit,
        "effects": effects,
        "mismatch": mismatch,
        "state": "consistent",
        "null_probability": 0.85,
    }
    return content | bare | more | {"sentence": words}


def write_fake_verdict(
    folder: Path,
    content: dict | None = None,
    table: pd.DataFrame | None = None,
    patches: pd.DataFrame | None = None,
    **readings,
) -> Path:
    """Write readings.csv (a table, or as fake_readings makes it), body_map.csv and verdict.json; return the folder."""
    tables = {
        READINGS: fake_readings(**readings) if table is None else table,
        BODY_MAP: fake_body_map() if patches is None else None if patches.empty else patches,
    }
    content = (content or fake_content()) | {"tables": write_tables(folder, tables)}
    write_verdict(folder, Verdict.model_validate(content))
    return folder
