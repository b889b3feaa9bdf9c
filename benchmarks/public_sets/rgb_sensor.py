"""A real pad calibrated by its own presses, predicted at other places and judged: baimukashev/RGB_sensor.

usage: python benchmarks/public_sets/rgb_sensor.py --source FOLDER [--places 6] [--out FOLDER]

Presses of `config/public_sets/rgb_sensor.import.yaml` go through `gelforge import`, half of the places drawn through
`gelforge calibrate`, the other half through `gelforge mismatch` with the calibrated study. Depth zero is the median contact
point of all presses. What is not known of the pad is assumed in `config/public_sets/rgb_sensor.yaml`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import yaml
from shared import found, parser_of, show_table

from gelforge.config import load_study
from gelforge.config.basis.variants import merged

REPOSITORY = "baimukashev/RGB_sensor"
LOGS = "data/labels/testing/main"
MAPPING = Path("config/public_sets/rgb_sensor.import.yaml")
STUDY = Path("config/public_sets/rgb_sensor.yaml")
FREE = ("gel.modulus", "gel.thickness", "contact_point")
THICKNESS_MM = "8:20"  # holds 90 % of what such pads are: a judgement
NEAR_MM = 1.5  # between two places that are one, to see how well presses repeat
NAMES = {
    "load": "loading",
    "unload": "unloading",
}


def gelforge(*arguments: str | Path) -> None:
    """Run a command of gelforge; what it prints goes to standard error."""
    one_thread = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    command = [sys.executable, "-m", "gelforge", *map(str, arguments)]
    done = subprocess.run(command, stdout=sys.stderr, env=os.environ | one_thread, check=False)
    if done.returncode:
        raise SystemExit(f"gelforge {arguments[0]}: ended with {done.returncode}")


def imported(logs: Path, out: Path, name: str, changes: dict) -> Path:
    """Write a session of the mapping with some keys changed, and return its folder."""
    mapping = yaml.safe_load(MAPPING.read_text()) | changes
    file = out / f"{name}.import.yaml"
    file.write_text(yaml.safe_dump(mapping))
    folder = out / name / "recordings" / name
    gelforge("import", file, "--data", logs, "--out", folder)
    return folder


def repeatability_N(folder: Path) -> tuple[float, int]:
    """Return the standard deviation of a reading along z [N] between presses at nearly one place, and their pairs."""
    table = pd.read_csv(folder / "indentations.csv")
    rest = table[table["phase"] == "zero"].groupby("press")["fz_N"].mean()
    table["fz_N"] -= rest.loc[table["press"]].to_numpy()
    table["level"] = (
        table["depth_mm"].round(1).where(table["depth_mm"] < 3.2, 9.0)
    )  # the deepest ones differ a little
    pressed = table[table["phase"] != "zero"]
    curves = pressed.pivot_table(index="press", columns=["phase", "level"], values="fz_N")
    places = pressed.groupby("press")[["x_mm", "y_mm"]].first().loc[curves.index].to_numpy()
    gaps = np.linalg.norm(places[:, None] - places[None], axis=2)
    pairs = np.argwhere(np.triu(gaps < NEAR_MM, 1))
    change = curves.to_numpy()[pairs[:, 0]] - curves.to_numpy()[pairs[:, 1]]
    return float(np.sqrt(np.nanmean(change**2) / 2)), len(pairs)


def rms(values: pd.Series) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def error_rows(half: str, readings: pd.DataFrame, columns: dict[str, str]) -> list[list[str]]:
    """Return rows of errors along z by phase; columns: what predicts, and its name in the readings."""
    along = readings[readings["axis"] == "z"]
    rows = []
    for phase, word in NAMES.items():
        own = along[along["phase"] == phase]
        size = rms(own["measured_N"])
        for what, column in columns.items():
            off = own["measured_N"] - own[column]
            if off.notna().any():
                text = [f"{rms(off):.2f}", f"{100 * rms(off) / size:.0f}", f"{off.mean():+.2f}"]
                rows.append([half, word, str(len(own)), what, *text])
    return rows


def main() -> None:
    parser = parser_of(__doc__, REPOSITORY)
    parser.add_argument("--places", type=int, default=6, help="of each half")
    parser.add_argument("--out", type=Path, help="folder to keep; a temporary one if not given")
    options = parser.parse_args()
    out = (options.out or Path(tempfile.mkdtemp())).resolve()
    out.mkdir(parents=True, exist_ok=True)
    logs = found(options.source, LOGS).resolve()
    whole = imported(logs, out, "all", {})
    contacts = pd.read_csv(whole / "import.csv")
    drawn = np.random.default_rng(0).permutation(contacts["number"])[: 2 * options.places]
    zero = {"depth_zero": {"at_mm": float(contacts["depth_zero_mm"].iloc[0])}}
    halves = {}
    for name, own in (("calibrated", drawn[: options.places]), ("predicted", drawn[options.places :])):
        others = sorted(set(contacts["number"]) - set(own))
        halves[name] = imported(logs, out, name, {**zero, "skip": list(map(int, others))}).parent
    gelforge("calibrate", halves["calibrated"], "--study", STUDY, "--free", ",".join(FREE), "--prior",
             f"gel.thickness={THICKNESS_MM}", "--out", out / "fit", "--no-page")  # fmt: skip
    patch = yaml.safe_load((out / "fit" / "config.patch.yaml").read_text())
    study = out / "calibrated.yaml"
    study.write_text(yaml.safe_dump(merged(load_study(STUDY).model_dump(mode="json"), patch)))
    gelforge("mismatch", halves["predicted"], "--study", study, "--out", out / "mismatch")
    tables(out, whole, contacts)


def tables(out: Path, whole: Path, contacts: pd.DataFrame) -> None:
    """Print what the folders hold."""
    fit = json.loads((out / "fit" / "calibration.json").read_text())
    again, pairs = repeatability_N(whole)
    print(f"{len(contacts)} presses within 8 mm of the middle, to {contacts['peak_N'].max():.1f} N; contact points"
          f" scatter by {contacts['contact_mm'].std():.2f} mm")  # fmt: skip
    print(f"repeatability of Fz: {again:.2f} N ({pairs} pairs of presses within {NEAR_MM} mm)\n")
    rows = []
    for one in fit["parameters"]:
        low, high = one["interval_90"]
        start = one["prior"]["interval_90"]
        rows.append(
            [one["name"], one["unit"], f"{start[0]:.3g} to {start[1]:.3g}", f"{one['value']:.3g}",
             f"{low:.3g} to {high:.3g}", "yes" if one["at_prior"] else "no"]
        )  # fmt: skip
    show_table(rows, ["parameter", "unit", "before (90 %)", "calibrated", "90 % interval", "at its prior"])
    print("".join(f"{sentence}\n" for sentence in fit["sentences"]))
    columns = {"before": "base_N", "calibrated": "after_N"}
    rows = error_rows("calibrated on", pd.read_csv(out / "fit" / "readings.csv"), columns)
    columns = {
        "calibrated": "base_N",
        "with the answer": "after_N",
        "with the answer of others": "predicted_N",
    }
    rows += error_rows("other places", pd.read_csv(out / "mismatch" / "readings.csv"), columns)
    show_table(rows, ["places", "phase", "readings", "by", "Fz off [N]", "%", "mean [N]"])
    verdict = json.loads((out / "mismatch" / "verdict.json").read_text())
    print(f"verdict on the other places: {verdict['state']}. {verdict['sentence']}\n")
    for group in verdict["answer"]:
        shares = group["shares"] or {name: group["probability"] for name in group["members"]}
        words = ", ".join(
            f"{name} {share:.2f}" for name, share in sorted(shares.items(), key=lambda one: -one[1])
        )
        print(f"credible set ({group['set_probability'] or group['probability']:.2f}): {words}")
    if held := verdict["fit"]["held_out"]:
        print(f"held out within them: log score gains {held['gain']:.0f} ± {held['standard_error']:.0f}")


if __name__ == "__main__":
    main()
