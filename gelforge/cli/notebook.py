"""Commands from a notebook: what they print is shown, and what fails stops the notebook with one line."""

from __future__ import annotations

import shlex
import subprocess
import sys
from importlib.util import find_spec

from gelforge.cli.extras import EXTRAS

PROGRAMS = ("gelforge", "snakemake")


class NotebookStop(ValueError):
    """The notebook cannot go on; Jupyter shows the message alone, without a traceback."""

    def _render_traceback_(self) -> list[str]:  # asked for by IPython
        return [f"gelforge: {self}"]


def require(*extras: str) -> None:
    """Stop the notebook where packages of these extras are missing.

    Parameters
    ----------
    *extras : str
        Extras of the installation: workflow, learning, live, bags, export.

    Raises
    ------
    NotebookStop
        Names what is missing and the command that installs it.

    Examples
    --------
    >>> import gelforge as gf
    >>> gf.require("learning")
    """
    if unknown := sorted(set(extras) - set(EXTRAS)):
        raise NotebookStop(f"no extras {unknown}; there are {', '.join(EXTRAS)}")
    lacking = {extra: [name for name in EXTRAS[extra] if find_spec(name) is None] for extra in extras}
    if missing := [name for names in lacking.values() for name in names]:
        wanted = ",".join(extra for extra, names in lacking.items() if names)
        raise NotebookStop(f'{", ".join(missing)} not installed; pip install "gelforge[{wanted}]"')


def run(command: str, quiet: bool = False) -> None:
    """Run a command of gelforge or Snakemake in the notebook's folder and Python, and print what it prints.

    Parameters
    ----------
    command : str
        The command line.
    quiet : bool
        Print nothing.

    Raises
    ------
    NotebookStop
        Another program, an extra that is missing, or a command that fails: then with its last line.

    Examples
    --------
    >>> import gelforge as gf
    >>> gf.run("gelforge sensors", quiet=True)
    """
    if not isinstance(command, str):
        raise NotebookStop(f'{command!r}: a command as text is needed, such as "gelforge check mine"')
    program, *arguments = shlex.split(command) or [""]
    if program not in PROGRAMS:
        raise NotebookStop(f"{program!r} is not run from here; {' and '.join(PROGRAMS)} are")
    if program == "snakemake":
        require("workflow")
    last = ""
    with subprocess.Popen(
        [sys.executable, "-m", program, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    ) as process:
        assert process.stdout is not None  # a pipe
        for line in process.stdout:
            print("" if quiet else line, end="")
            last = line.strip() or last
    if process.returncode:
        raise NotebookStop(f"`{command}` ended with status {process.returncode}: {last}")
