"""The console of a run: a bar, a line per stage, and nothing of each job."""

import io
import logging
import re
from types import SimpleNamespace

import pytest
from snakemake_interface_logger_plugins.common import LogEvent

from gelforge.workflow.run_progress import NotOfEachJob, StageLines, stage_of

RULES = {1: "plan", 2: "simulate", 3: "simulate", 4: "derive_0", 5: "report"}


@pytest.fixture
def run():
    """Return a logger, its console's text, and a clock moved by hand [s], of a run of RULES."""
    logger, out, clock = logging.Logger("run"), io.StringIO(), SimpleNamespace(now=0.0)
    console = logging.StreamHandler(out)
    console.addFilter(NotOfEachJob())
    costs = {"simulate": 10.0}
    lines = StageLines(RULES, costs, 2, out, lambda: clock.now)
    logger.handlers = [lines, console]
    return SimpleNamespace(logger=logger, out=out, clock=clock, lines=lines, costs=costs)


def begin(run, job):
    run.logger.info("Rule ...", extra={"event": LogEvent.JOB_INFO, "jobid": job})


def finish(run, job):
    run.logger.info("Finished jobid ...", extra={"event": LogEvent.JOB_FINISHED, "job_id": job})


def test_a_log_has_a_line_per_stage_and_none_per_job(run):
    for job in RULES:
        run.logger.info("Select jobs to execute...")
        begin(run, job)
        run.clock.now += 20.0
        finish(run, job)
    ends = [line for line in run.out.getvalue().splitlines() if not line.startswith("[")]
    assert ends == [
        "plan: done in 20 s",
        "sites, 2 jobs: done in 40 s",
        "mirrored and interpolated sites: done in 20 s",
        "report: done in 20 s",
    ]


def seconds_left(run):
    """Return the time left in a console's line [s]."""
    return int(re.search(r"about (\d+) s left", run.lines.text())[1])


def test_the_time_left_starts_as_expected_and_a_long_job_brings_the_end_nearer(run):
    # The time left starts as what the jobs are expected to take
    assert seconds_left(run) == pytest.approx(23 / 2, abs=0.6)  # 23 core seconds on two cores

    # A long job brings the end nearer while it runs
    begin(run, 2)
    before = seconds_left(run)
    run.clock.now += 8.0
    assert seconds_left(run) < before
    run.clock.now += 100.0
    assert seconds_left(run) >= 1  # overdue, and not done


def test_the_time_left_follows_the_pace_of_the_run(run):
    """A machine is four times as slow as expected: half way the time left is nearer to the truth than what was expected."""
    for job in (1, 2):
        begin(run, job)
        run.clock.now += 4 * run.costs.get(RULES[job], 1.0) / 2
        finish(run, job)
    expected, true = 12 / 2, 4 * 12 / 2
    assert expected < seconds_left(run) < true


def test_errors_last_words_and_stages_are_shown(run):
    run.logger.error("Error in rule", extra={"event": LogEvent.JOB_ERROR, "jobid": 2})
    run.logger.info("Complete log(s): x.log")
    assert run.out.getvalue() == "Error in rule\nComplete log(s): x.log\n"

    # Rules without a stage are stages
    assert (stage_of("tables"), stage_of("derive_12")) == ("tables", "mirrored and interpolated sites")
