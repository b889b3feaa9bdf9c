"""A small seeded set of `python -m benchmarks.faults inputs`; docs/results/faults.md has the table of the large one."""

from collections import Counter

import pytest

from benchmarks.fault_kinds.inputs import run_all
from benchmarks.fault_kinds.outcomes import WRONG


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize(("seed", "count"), [(11, 24), (11, 64), (12, 64)])  # each kind once or twice
def test_mutants_are_refused_in_a_line_or_change_nothing(seed, count):
    faults = run_all(seed, count)
    wrong = [f"{f.outcome}: {f.kind}: {f.what}: {f.said[-300:]}" for f in faults if f.outcome in WRONG]
    assert not wrong, "\n".join(wrong)
    assert Counter(f.outcome for f in faults)["refused"] > 0.65 * count  # and not that nothing was looked at
