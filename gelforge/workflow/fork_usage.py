"""CPU seconds and memory of forks in Snakemake's benchmark files; by itself it measures the process that waits for one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from gelforge.workflow.fork_server import usage_file


def measure_forks(benchmark: Any, address: str) -> None:
    """Let Snakemake's module of benchmarks state what the forks of a server used. address: of the server."""
    measured = benchmark.benchmarked

    @contextmanager
    def benchmarked(pid: Any = None, *arguments, **options) -> Iterator[Any]:
        with measured(pid, *arguments, **options) as record:
            yield record
        take_usage(record, usage_file(address, pid or os.getpid()))

    benchmark.benchmarked = benchmarked


def take_usage(record: Any, path: str) -> None:
    """Put a job's CPU seconds and largest memory [MB] into its benchmark record; nothing where no fork ran it."""
    try:
        with open(path, encoding="ascii") as file:
            cpu_s, memory_MB = map(float, file.read().split())
        os.unlink(path)
    except FileNotFoundError:
        return
    record.cpu_time, record.max_rss = cpu_s, memory_MB
    record.cpu_usage = 100 * cpu_s  # per cent times seconds
    record.data_collected = True
    for name in ("max_vms", "max_uss", "max_pss", "io_in", "io_out"):  # known of the process that waits alone
        setattr(record, name, None)
