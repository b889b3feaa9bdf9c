"""The console of a run: a bar with the stage that runs and the time left, and a line as each stage ends.

What Snakemake says of each job goes to its log file alone (.snakemake/log); errors, warnings and its last words stay.
"""

import logging
import sys
import time
from collections import Counter
from collections.abc import Iterable, Mapping
from typing import TextIO

from snakemake_interface_logger_plugins.common import LogEvent

from gelforge.progress import duration

STAGES = {  # by rule; a rule that is not here is a stage of its own name
    "study": "plan",
    "plan": "plan",
    "characterise": "materials",
    "virtual_materials": "synthetic material tests",
    "virtual_cell": "sites of the virtual sensor",
    "virtual_session": "synthetic recordings",
    "simulate": "sites",
    "solve_site": "sites",
    "level": "sites",
    "session_cell": "sites",
    "session_presses": "indentations in recorded order",
    "variant": "variants",
    "site_sensitivities": "derivatives",
    "readings": "readings",
    "features": "images",
    "solve_synthesis": "presses of the simulated training set",
    "synthesise": "simulated training rows",
    "join": "dataset",
    "manifest": "dataset",
    "train": "training",
    "evaluate": "predictions",
    "export": "export to ONNX",
    "onnx_check": "ONNX Runtime against PyTorch",
    "mismatch": "verdict",
    "verify": "checks of the finite elements",
}
DERIVED = "mirrored and interpolated sites"
OF_EACH_JOB = {
    *(LogEvent.JOB_INFO, LogEvent.JOB_STARTED, LogEvent.JOB_FINISHED),
    *(LogEvent.GROUP_INFO, LogEvent.PROGRESS),
}
OF_EACH_ROUND = (
    *("Select jobs to execute", "Execute ", "Waiting for more resources"),
    *("Finished jobid", "DAG of jobs will be"),
)

# of expected time weigh as much as measured time: the first jobs load libraries and tell little
TRUSTED_S = 30.0


def stage_of(rule: str) -> str:
    """Return the stage that a rule belongs to, in words."""
    return DERIVED if rule.startswith("derive_") else STAGES.get(rule, rule.replace("_", " "))


class StageLines(logging.Handler):
    """Counts jobs as they start and finish; a handler of Snakemake's logger.

    Parameters
    ----------
    rules
        Rule of each job that is to run, by the job's number.
    costs
        Expected core seconds of a job, by rule; a rule that is missing takes one second.
    cores
        Cores that the jobs share.

    Notes
    -----
    The time left starts as the expected one and follows the measured pace as jobs end.
    """

    def __init__(
        self,
        rules: Mapping[int, str],
        costs: Mapping[str, float],
        cores: int = 1,
        out: TextIO | None = None,
        clock=time.monotonic,
    ):
        super().__init__(logging.INFO)
        self._rules, self._costs, self._cores = dict(rules), costs, max(cores, 1)
        self._out, self._clock = out or sys.stderr, clock
        self._left, self._all = set(rules), Counter(map(stage_of, rules.values()))
        self._ended: Counter = Counter()
        self._running: dict[int, tuple[float, int]] = {}  # start and threads, by job
        self._began: dict[str, float] = {}
        self._weight = self._weigh(rules)
        self._start, self._said = clock(), float("-inf")
        self._terminal = self._out.isatty()

    def emit(self, record: logging.LogRecord) -> None:
        """Take note of a job that starts or has finished."""
        event, job = getattr(record, "event", None), getattr(record, "jobid", getattr(record, "job_id", None))
        if event == LogEvent.JOB_INFO and job in self._left:
            now = self._clock()
            self._running[job] = now, getattr(record, "threads", None) or 1
            self._began.setdefault(stage_of(self._rules[job]), now)
            self._show()
        elif event == LogEvent.JOB_FINISHED and job in self._left:
            self._finish(job)
        elif event == LogEvent.JOB_ERROR:
            if job is not None:
                self._running.pop(job, None)
            self._clear()
        elif record.levelno > logging.INFO:
            self._clear()

    def _finish(self, job: int) -> None:
        self._left.discard(job)
        self._running.pop(job, None)
        stage, now = stage_of(self._rules[job]), self._clock()
        self._ended[stage] += 1
        if self._ended[stage] == self._all[stage]:
            took = duration(now - self._began.get(stage, now))
            count = f", {self._all[stage]} jobs" if self._all[stage] > 1 else ""
            self._clear()
            self._print(f"{stage}{count}: done in {took}\n")
        if self._left:
            self._show()
        else:
            self._clear()

    def text(self) -> str:
        """Return the bar, how many jobs have ended, what runs, and about how long the rest will take."""
        done = self._weight - self._weigh(self._left) + self._in_progress()
        bar = "#" * int(24 * done / self._weight)
        stages = dict.fromkeys(stage_of(self._rules[job]) for job in sorted(self._running))
        words = [f"[{bar:.<24}] {len(self._rules) - len(self._left)} of {len(self._rules)} jobs"]
        words += [f"{stage} {self._ended[stage]} of {self._all[stage]}" for stage in stages]
        expected, elapsed = done / self._cores, self._clock() - self._start
        pace = (elapsed + TRUSTED_S) / (expected + TRUSTED_S)
        words.append(f"about {duration(pace * (self._weight - done) / self._cores)} left")
        return "; ".join(words)

    def _in_progress(self) -> float:
        """Return the core seconds that running jobs have done; an overdue job counts as nearly done."""
        now = self._clock()
        return sum(
            min((now - start) * threads, 0.95 * self._costs.get(self._rules[job], 1.0))
            for job, (start, threads) in self._running.items()
        )

    def _weigh(self, jobs: Iterable[int]) -> float:
        return sum(self._costs.get(self._rules[job], 1.0) for job in jobs)

    def _show(self) -> None:
        now = self._clock()
        if now - self._said < (0.2 if self._terminal else 60.0):  # s
            return
        self._said = now
        self._print(f"\r\033[2K{self.text()}" if self._terminal else f"{self.text()}\n")

    def _clear(self) -> None:
        if self._terminal:
            self._print("\r\033[2K")
            self._said = float("-inf")

    def _print(self, words: str) -> None:
        print(words, end="", file=self._out, flush=True)


class NotOfEachJob(logging.Filter):
    """Keeps what Snakemake says of each job and each round of scheduling from its console."""

    def filter(self, record: logging.LogRecord) -> bool:
        """Return whether a record is shown."""
        if record.levelno > logging.INFO:
            return True
        of_job = getattr(record, "event", None) in OF_EACH_JOB
        return not of_job and not str(record.msg).startswith(OF_EACH_ROUND)


def show_stages(
    logger: logging.Logger, rules: Mapping[int, str], costs: Mapping[str, float], cores: int
) -> None:
    """Show stages instead of jobs on the console of this run; the rest is as in `StageLines`."""
    console = [handler for handler in logger.handlers if handler.name == "DefaultStreamHandler"]
    for handler in console:
        handler.addFilter(NotOfEachJob())
    # before the console: an error is not written behind the bar
    logger.handlers.insert(0, StageLines(rules, costs, cores))
