"""What the speed table counts: every process of a command, those it leaves behind too; a dash where a state refuses."""

import sys

import pytest
from speed import line_of
from two_states import cost_of

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="orphans are adopted on Linux only")

BURN = "import time\nwhile time.process_time() < {seconds}: pass\n"


@pytest.fixture
def module(tmp_path):
    """Return a function that writes a module into a state's folder and runs it there."""

    def run(code, limit_s=60.0):
        (tmp_path / "command.py").write_text(code)
        return cost_of(["command"], tmp_path, limit_s)

    return run


def test_processes_that_outlive_status_memory_and_the_limit_count(module, tmp_path):
    # A process that outlives its command counts
    (tmp_path / "left.py").write_text(BURN.format(seconds=0.5))
    done = module("import subprocess, sys\nsubprocess.Popen([sys.executable, 'left.py'])\nprint('begun')\n")
    assert done.status == 0
    assert done.cpu_s > 0.5
    assert done.printed == "begun\n"

    # Status memory and the limit
    done = module("import sys\nheld = b'x' * 200_000_000\nsys.exit(3)\n")
    assert done.status == 3
    assert done.memory_MB > 190

    # The limit ends a command
    assert module("import time\ntime.sleep(1000)\n", limit_s=0.2).status == 124


def test_line_of_a_table():
    assert line_of({"before": [3.0, 30.0, 4.0], "now": [2.0, 1.0, 2.0]}) == {
        "before": "4",
        "now": "2",
        "before / now": "2.0",
    }
    assert line_of({"before": [None], "now": [2.0]}) == {"before": "-", "now": "2", "before / now": "-"}
    assert line_of({"now": [1234.4]}) == {"now": "1234"}
