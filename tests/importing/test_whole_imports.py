"""Whole imports of made logs that are not CSV: the same truth comes out."""

import numpy as np
import pandas as pd
import pytest
import yaml
from raw_logs import MAPPING, Lab, generate
from test_other_sources import mcap

from gelforge.importing.importer import import_logs

LAB = Lab(presses=4, lead_s=1.0)
TOPICS = {"Time": "/ft", "t_ms": "/stage"}


def truth_is_found(tmp_path, truth, name):
    found = import_logs(tmp_path / name, "s1")
    assert found.force_clock.lag_s == pytest.approx(LAB.force_lag_s, abs=0.01)
    assert np.abs(found.contacts["contact_mm"] - truth.contact_z_mm).max() < 0.04
    assert np.abs(found.contacts["touch_s"] - truth.touch_s).max() < 0.05


def test_one_mcap_holds_both_logs(tmp_path):
    truth = generate(tmp_path, LAB, seed=2)
    tables = [pd.read_csv(tmp_path / name) for name in ("ft.csv", "stage.csv")]
    mcap(tmp_path / "run.mcap", {TOPICS[table.columns[0]]: table.to_dict("records") for table in tables})
    mapping = yaml.safe_load(MAPPING)
    mapping["force"] |= {"file": "run.mcap", "topic": "/ft"}
    mapping["stage"] |= {"file": "run.mcap", "topic": "/stage"}
    (tmp_path / "bag.yaml").write_text(yaml.safe_dump(mapping))
    truth_is_found(tmp_path, truth, "bag.yaml")


def test_the_stage_ran_gcode(tmp_path):
    """Waits and ways as the generator draws them, written as G-code with its speeds."""
    truth = generate(tmp_path, LAB, seed=2)
    rng = np.random.default_rng(2)
    top = LAB.contact_mm + LAB.retreat_mm
    lines = [f"G21 G90\nG0 X10 Y12 Z{top}\nG4 S{LAB.lead_s}"]
    for k in range(LAB.presses):
        depth = LAB.depths[k % len(LAB.depths)]
        lines.append(f"G4 S{rng.uniform(*LAB.rests)}")
        lines.append(
            f"G1 Z{LAB.contact_mm + 0.5} F{60 * LAB.fast}\nG1 Z{LAB.contact_mm - depth} F{60 * LAB.slow}"
        )
        lines.append(f"G4 S{rng.uniform(*LAB.waits)}\nG1 Z{top} F{60 * LAB.slow}")
    (tmp_path / "moves.gcode").write_text("\n".join([*lines, f"G4 S{LAB.lead_s}"]))
    mapping = yaml.safe_load(MAPPING)
    mapping["stage"] = {"file": "moves.gcode", "gcode": {"acceleration_mm_s2": LAB.acceleration}, "x": "X", "y": "Y",
                        "z": "Z", "unit": "mm", "pressing": "-z"}  # fmt: skip
    (tmp_path / "gcode.yaml").write_text(yaml.safe_dump(mapping))
    truth_is_found(tmp_path, truth, "gcode.yaml")
