"""The command line: each command parses, reads, makes one call and writes.

Commands are imported when they run, so that `gelforge --help` and a refused argument cost nothing.
"""

from __future__ import annotations

import os
import sys
import warnings
from importlib import import_module
from pathlib import Path

from gelforge.cli.arguments import parser


def main(argv: list[str] | None = None) -> int:
    """Run one command and return its exit status; an error of ours is one plain message."""
    arguments = vars(parser().parse_args(argv))
    debug, (module, function) = arguments.pop("debug"), arguments.pop("run").split(".")
    keep_compiled_kernels()
    warnings.formatwarning = one_line
    try:
        getattr(import_module(f"gelforge.cli.{module}"), function)(**arguments)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:  # the reader of a pipe (`gelforge ... | head`) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ValueError as error:
        if debug or not type(error).__module__.startswith("gelforge."):
            raise
        print(f"gelforge: {error}", file=sys.stderr)
        return 1
    return 0


def one_line(message, category, filename, lineno, line=None, usual=warnings.formatwarning) -> str:
    """Return a warning of ours as one line, another one as Python writes it."""
    ours = category.__module__.startswith("gelforge.")
    return f"gelforge: {message}\n" if ours else usual(message, category, filename, lineno, line)


def keep_compiled_kernels() -> None:
    """Let numba keep compiled kernels in one folder of the checkout, whoever runs them first."""
    checkout = Path(__file__).parents[2]
    if (checkout / "pyproject.toml").is_file():
        os.environ.setdefault("NUMBA_CACHE_DIR", str(checkout / ".numba_cache"))
