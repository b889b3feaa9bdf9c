"""The command line: each command parses, reads, makes one call and writes.

Commands are imported when they run, so that `gelforge --help` and a refused argument cost nothing.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from importlib import import_module
from pathlib import Path

from gelforge.cli.arguments import complete, parser
from gelforge.progress import show


def main(argv: list[str] | None = None) -> int:
    """Run one command.

    Parameters
    ----------
    argv : list of str, optional
        Arguments of the command line; None for those of this process.

    Returns
    -------
    int
        Exit status: 0, 1 for a refusal in one line, 2 for wrong arguments, 130 when interrupted, 143 when terminated.
    """
    commands = parser()
    complete(commands)
    arguments = vars(commands.parse_args(argv))
    debug, (module, _, function) = arguments.pop("debug"), arguments.pop("run").rpartition(".")
    keep_compiled_kernels()
    open_without_locks()
    stop_in_order()
    show()
    try:
        getattr(import_module(f"gelforge.cli.{module}"), function)(**arguments)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    except (Terminated, RuntimeError) as error:
        if isinstance(error, RuntimeError) and not isinstance(error.__cause__, Terminated):
            raise  # else Python has wrapped the signal, as while a class is made
        print("gelforge: terminated (SIGTERM); nothing half written is left, run again", file=sys.stderr)
        return 143
    except BrokenPipeError:  # the reader of a pipe (`gelforge ... | head`) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ValueError as error:
        if debug or not type(error).__module__.startswith("gelforge."):
            raise
        print(f"gelforge: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        if debug:
            raise
        print(f"gelforge: {of_the_machine(error)}", file=sys.stderr)
        return 1
    except ModuleNotFoundError as error:
        from gelforge.cli.extras import missing_extra

        if debug or not (words := missing_extra(error)):
            raise
        print(f"gelforge: {words}", file=sys.stderr)
        return 1
    except (MemoryError, ImportError) as error:
        if debug or (isinstance(error, ImportError) and not any(words in str(error) for words in NOT_MAPPED)):
            raise
        print("gelforge: no memory is left; give the job more, or use a coarser mesh", file=sys.stderr)
        return 1
    finally:
        if workers := sys.modules.get("gelforge.workers"):
            workers.end()
    return 0


# of the dynamic linker, where a library of PyTorch or OpenCV finds no memory
NOT_MAPPED = ("failed to map segment", "annot allocate memory")


class Terminated(BaseException):
    """SIGTERM has come."""


def stop_in_order() -> None:
    """Let SIGTERM unwind the command, so that temporary files are removed; a second one ends it at once.

    Where a library has called Python, an exception would not arrive: there the signal comes again a little later.
    """
    usual = sys.unraisablehook

    def stop(number, frame):
        if _in_a_library(frame):
            again()
        else:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            raise Terminated

    def again():
        # a signal that came at a bad moment comes again, 20 ms later
        timer = threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGTERM))
        timer.daemon = True
        timer.start()

    def lost(error):
        if error.exc_type is Terminated:
            signal.signal(signal.SIGTERM, stop)
            again()
        else:
            usual(error)

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, stop)
        sys.unraisablehook = lost


def _in_a_library(frame) -> bool:
    """Return whether HDF5 has called the Python code that is running."""
    hdf5 = sys.modules.get("gelforge.hdf5")
    while hdf5 and frame:
        if frame.f_code in hdf5.CALLED_BY_HDF5:
            return True
        frame = frame.f_back
    return False


def open_without_locks() -> None:
    """Let HDF5 open files where the file system has no locks; whoever sets the variable decides.

    Products appear under their names when they are whole and are never written again, so nothing is to be locked.
    BEST_EFFORT would not do: HDF5 ignores a missing function (ENOSYS) then, and not a refused lock (ENOLCK).
    """
    os.environ.setdefault("HDF5_USE_FILE_LOCKING", "FALSE")


def of_the_machine(error: OSError) -> str:
    """Return an error of the operating system as one line: which file, what, what to do."""
    from gelforge.files import no_room, why_not_read

    name = f"{error.filename}: " if error.filename else ""
    if reason := no_room(error):
        return f"{name}not written, {reason}; make room and run again"
    return f"{name}{why_not_read(error)}"


def keep_compiled_kernels() -> None:
    """Let numba keep compiled kernels in one folder of the checkout, whoever runs them first."""
    checkout = Path(__file__).parents[2]
    if (checkout / "pyproject.toml").is_file():
        os.environ.setdefault("NUMBA_CACHE_DIR", str(checkout / ".numba_cache"))
