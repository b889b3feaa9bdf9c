"""Set-up of every test: one thread for the numerical libraries, kernels kept between runs, no time limit for an example.

Tests marked `thorough` are left out unless pytest is given --thorough: slow statistics, and further cases of what another
case shows (`thorough(but_first=n)` keeps the first n cases of a test).
"""

import os
from collections import Counter

# Before numpy is imported: two cores are shared by what runs next to the tests, and sums keep their order.
for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(name, "1")

from hypothesis import HealthCheck, settings  # noqa: E402

from gelforge.cli import keep_compiled_kernels  # noqa: E402

keep_compiled_kernels()
# A busy machine is no failure: by default an example may take 0.2 s.
settings.register_profile("untimed", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("untimed")


def pytest_addoption(parser):
    parser.addoption("--thorough", action="store_true", help="run the slow tests too")


def _turn(item) -> int:
    """Return when a test's file comes: the longest first, or one core ends alone.

    test_runs.py makes the finished study; test_faults.py, which needs it too, comes so late that no core waits for it.
    """
    if "workflow" not in item.path.parts:
        early = ("mismatch", "indentation", "verification", "tests")  # the last: files of no folder
        return 2 if item.path.parent.name in early else 4
    return {"test_runs.py": 0, "test_faults.py": 3}.get(item.path.name, 1)


def pytest_collection_modifyitems(config, items):
    items.sort(key=_turn)
    if config.getoption("--thorough"):
        return
    kept, left_out, seen = [], [], Counter()
    for item in items:
        marker = item.get_closest_marker("thorough")
        case = item.nodeid.partition("[")[0]
        seen[case] += 1
        keep = marker is None or seen[case] <= marker.kwargs.get("but_first", 0)
        (kept if keep else left_out).append(item)
    config.hook.pytest_deselected(items=left_out)
    items[:] = kept
