"""How long the sites of a run will still take: Snakemake counts its jobs, quick and slow ones alike, and says no time."""

import logging

from snakemake_interface_logger_plugins.common import LogEvent

from gelforge.progress import Progress, show


class Solved(logging.Handler):
    """Counts the jobs that solve as they finish; a handler of Snakemake's logger."""

    def __init__(self, jobs: set[int]):
        super().__init__(logging.INFO)
        show()
        self._left = set(jobs)
        self._progress = Progress("sites solved", len(jobs), rewritten=False)
        self._progress.__enter__()

    def emit(self, record: logging.LogRecord) -> None:
        finished = getattr(record, "event", None) == LogEvent.JOB_FINISHED and record.job_id in self._left
        if finished:
            self._left.remove(record.job_id)
            self._progress.advance()
            if not self._left:
                self._progress.__exit__(None, None, None)
