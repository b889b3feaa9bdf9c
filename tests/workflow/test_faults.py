"""Some faults of benchmarks/faults.py on the finished test study; docs/results/faults.md has the large sets."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.thorough(but_first=1)  # a run that is killed and goes on: test_resume.py too
@pytest.mark.parametrize(("part", "count"), [("products", 2), ("kills", 2), ("products", 16), ("kills", 11)])
def test_what_is_damaged_or_killed_changes_no_result(finished, part, count):
    """Damaged products are refused in one line or change nothing; a killed stage leaves nothing and gives the same again."""
    command = [sys.executable, "-m", "benchmarks.faults", part, "--count", str(count), "--seed", "35"]
    done = subprocess.run(
        [*command, "--study", str(finished.folder)],
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]
    row = done.stdout.splitlines()[-1]
    assert row.startswith(f"| all | {count} |"), done.stdout
