"""Run one gelforge command in a fork of a process that has loaded everything; without one, in a process of its own.

    python -I -S gelforge/workflow/fork_server.py SOCKET simulate --study ... --out ...

A job that starts Python, imports and loads compiled kernels, MKL or PyTorch spends seconds before it does anything. Each
Snakemake that runs jobs itself therefore starts one fork server (`started`). It loads what a command needs when that is
first asked for, and forks for each job: the fork gets the job's arguments, working folder, environment, standard output and
error. Where nobody answers, where loading failed, and where the sources have been edited since the server began to load,
the job does the same in a process of its own. What a fork used stands in `usage_file`, for Snakemake's benchmark files
(fork_usage.py).

The job's side imports little, so that it starts in 20 ms.
"""

import json
import os
import signal
import socket
import struct
import sys
from functools import cache

# Commands that solve: their forks find kernels and direct solver loaded.
SOLVING = {
    *("simulate", "level", "derive", "sensitivities", "virtual-cell"),
    *("simulate-session", "solve-synthesis", "verify", "mismatch"),
}
# What the others import, most of it used by several.
IMPORTS = {
    "fit-law": "gelforge.materials.characterise",
    "plan": "gelforge.indentation.planning.plan",
    "virtual-session": "gelforge.virtual_lab.session",
    "readings": "gelforge.recording.readings",
    "features": "gelforge.recording.features",
    "join": "gelforge.dataset.join",
    "manifest": "gelforge.dataset.manifest",
    "agreement": "gelforge.dataset.agreement",
    "synthesise": "gelforge.synthesis.rows",
    "train": "gelforge.learning.training.train",
    "evaluate": "gelforge.learning.judging.predictions",
    "export": "gelforge.learning.training.train",
    "onnx-check": "gelforge.learning.judging.predictions",
    "tables": "gelforge.learning.judging.evaluation",
}
NOBODY = "-"  # no address
USAGE = struct.Struct("dd")  # CPU seconds and memory [MB], as a fork tells its job

THREADS = {name: "1" for name in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}


# ------------------------------------------------------------------------------------------------- for Snakemake
def started() -> tuple[str, object]:
    """Return the address of a new server and its process, which ends when its standard input is closed.

    The address is NOBODY where forks are no way: threads of macOS's libraries do not survive one.
    """
    import subprocess
    import tempfile

    if sys.platform != "linux":
        return NOBODY, None
    address = os.path.join(tempfile.mkdtemp(prefix="gelforge-"), "forks")
    command = [sys.executable, __file__, "--serve", address]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        env=os.environ | THREADS,
        start_new_session=True,  # Ctrl-C goes to the jobs, which pass it on
    )
    return address, process


# ------------------------------------------------------------------------------------------------------- the job
def ask(address: str, arguments: list[str]) -> int:
    """Return the exit status of a command, run by a fork; -1 where there is none that would run it."""
    passed: list[int] = []
    fork = 0

    def pass_on(number, frame):
        passed.append(number)
        if not fork:  # nobody works for this job yet
            os._exit(128 + number)
        send(number)
        if number == signal.SIGINT:
            # after Ctrl-C a job has 4 s to end: compiled code may not look up earlier
            signal.setitimer(signal.ITIMER_REAL, 4.0)

    def send(number):
        try:
            os.kill(fork, number)
        except ProcessLookupError:
            pass

    signal.signal(signal.SIGALRM, lambda *_: send(signal.SIGKILL))
    before = {number: signal.signal(number, pass_on) for number in (signal.SIGTERM, signal.SIGINT)}
    request = json.dumps({"arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)})
    try:
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        connection.connect(address)
        socket.send_fds(connection, [len(request.encode()).to_bytes(4, "big")], [1, 2])
        connection.sendall(request.encode())
        fork = int.from_bytes(_read(connection, 4), "big")
    except OSError:
        pass
    if not fork:
        for number, handler in before.items():
            signal.signal(number, handler)
        return -1
    if status := _read(connection, 4):
        _keep_usage(address, _read(connection, USAGE.size))
        return int.from_bytes(status, "big")
    if passed:
        return 128 + passed[0]
    print("gelforge: the process was killed; if no memory was left, give the job more", file=sys.stderr)
    return 137


def usage_file(address: str, pid: int) -> str:
    """Return where the CPU seconds and the largest memory [MB] of a job stand, by the process that was started for it."""
    return f"{address}.{pid}"


def _keep_usage(address: str, usage: bytes) -> None:
    """Write what the fork used; the process that was started is this one or the shell that started it."""
    if not usage:
        return
    for pid in (os.getpid(), os.getppid()):
        try:
            with open(usage_file(address, pid), "w", encoding="ascii") as file:
                print(*USAGE.unpack(usage), file=file)
        except OSError:  # the Snakemake that would read it is no more
            pass


def _read(connection: socket.socket, count: int) -> bytes:
    """Return so many bytes; none where the other end has closed before."""
    received = b""
    while len(received) < count:
        part = connection.recv(count - len(received))
        if not part:
            return b""
        received += part
    return received


# ------------------------------------------------------------------------------------------- the forking process
def serve(address: str) -> None:
    """Fork for each job that asks, until standard input is closed: the Snakemake that started this is no more."""
    import selectors
    import shutil

    from gelforge.cli import keep_compiled_kernels, open_without_locks

    keep_compiled_kernels()
    open_without_locks()
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listening.bind(address)
    listening.listen(128)  # jobs that may wait while the server loads
    waiting = selectors.DefaultSelector()
    waiting.register(listening, selectors.EVENT_READ)
    waiting.register(sys.stdin, selectors.EVENT_READ)
    code = ""
    while sys.stdin not in (asking := [key.fileobj for key, _ in waiting.select(1.0)]):
        collect()
        if not asking:
            continue
        connection = listening.accept()[0]
        try:
            head, outputs, _, _ = socket.recv_fds(connection, 4, 2)
            request = json.loads(_read(connection, int.from_bytes(head, "big")))
        except (OSError, ValueError):  # a job that was killed as it asked
            connection.close()
            continue
        code = code or digest()  # before what solves, reads and learns is imported: a later edit is seen
        load(request["arguments"][0])
        if not os.fork():
            listening.close()
            os._exit(run(connection, request, outputs, code))
        for opened in (*outputs, connection.detach()):
            os.close(opened)
    collect()
    shutil.rmtree(os.path.dirname(address), ignore_errors=True)
    os._exit(0)  # nothing that was loaded needs to be taken down in order


def digest() -> str:
    """Return the digest of the package's code as it is now."""
    from gelforge.files import source_digest

    return source_digest(".")


@cache
def load(command: str) -> None:
    """Load what a command needs, once."""
    from contextlib import suppress
    from importlib import import_module

    if command in SOLVING:
        load_solver()
    elif command in IMPORTS:
        # an extra that this study may not need; else its fork names the extra
        with suppress(ModuleNotFoundError):
            import_module(IMPORTS[command])


@cache
def load_solver() -> None:
    """Load what solves a site, compiled kernels and direct solver too, by a tiny press."""
    from gelforge.cli.by_hand.warm_up import tiny_press
    from gelforge.mismatch.fem import site_slopes  # noqa: F401

    tiny_press("finite")


def collect() -> None:
    """Let the system forget forks that have ended, and count their CPU time as this process's children's."""
    try:
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass
    except ChildProcessError:
        pass


def run(connection: socket.socket, request: dict, outputs: list[int], code: str) -> int:
    """Run one command in this fork, tell the job its exit status and what it used, and return the status."""
    import threading

    from gelforge.cli import main

    if digest() != code:
        connection.sendall(bytes(4))
        return 0
    for number, output in zip((1, 2), outputs):
        os.dup2(output, number)
        os.close(output)
    sys.stdout, sys.stderr = (open(number, "w", closefd=False, buffering=1) for number in (1, 2))
    os.chdir(request["folder"])
    os.environ.clear()
    os.environ.update(request["environment"])
    try:
        connection.sendall(os.getpid().to_bytes(4, "big"))
    except OSError:  # the job was ended while this process loaded
        return 0
    threading.Thread(target=_end_with, args=[connection], daemon=True).start()
    try:
        status = main(request["arguments"])
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else 1
    except BaseException:
        import traceback

        traceback.print_exc()
        status = 1
    sys.stdout.flush()
    sys.stderr.flush()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # of `_end_with`, when the job has its answer
    connection.sendall((status or 0).to_bytes(4, "big") + _usage())
    return status or 0


def _usage() -> bytes:
    """Return the CPU seconds of this fork and its children, and the largest resident set of one of them [MB]."""
    import resource

    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu_s = sum(one.ru_utime + one.ru_stime for one in used)
    return USAGE.pack(cpu_s, max(one.ru_maxrss for one in used) / 1024)


def _end_with(connection: socket.socket) -> None:
    """End this fork when its job has ended without waiting for it."""
    try:
        connection.recv(1)
    except OSError:
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    if sys.argv[1] == "--serve":
        serve(sys.argv[2])
    else:
        status = ask(sys.argv[1], sys.argv[2:])
        if status < 0:
            os.execv(sys.executable, [sys.executable, "-m", "gelforge", *sys.argv[2:]])
        sys.exit(status)
