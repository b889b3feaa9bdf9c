"""A set of cases on disk: recordings in the open, truths sealed, verdicts hashed before any truth is opened.

SET/sealed.json          published before judging: seed, content, SHA-256 of every salted truth and recording
SET/cases/<case>/        recordings/<session>/..., and base.txt: the configuration that it is judged against
SET/truth/<case>.json    salt and truth
SET/verdicts/<case>/     what the judge wrote
SET/judged.json          SHA-256 of every verdict, written case by case
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from . import sealing
from .archive import with_current_keys
from .draw import BASES, DEVELOPMENT, SNR, cases
from .library import Library
from .pressed import VERSION
from .recording import write_recording
from .sealing import JUDGED, REGISTER, SEALED

CONFIG = Path(__file__).parent / "config"
COMMAND = (
    f"{sys.executable} -m gelforge mismatch {{recording}} --config {{config}} {{laws}} --out {{out}}"
    f" --kept {{kept}} --no-page"
)
LAWS = {  # constitutive models with a covariance, of bases that have them: for {laws}
    "thin": [CONFIG / "thin_gel.json", CONFIG / "thin_skin.json"],
}


def generate(
    libraries: Mapping[str, Library],
    folder: Path,
    seed: int,
    numbers: dict[str, int],
    commit: str = "",
    bases: Sequence[str] = ("concealed",),
    least: float = SNR[0],
) -> dict:
    """Write a set and return its publication. Cases that are there are written again, to the same bytes.

    libraries, numbers, bases and least as `draw.cases` has them.
    """
    hashes = {}
    for case in cases(libraries, seed, numbers, bases, least):
        out = folder / "cases" / case.name
        base = BASES[case.base]
        sensor, exact = libraries[base.sensor].sensor, not base.doubts
        sessions = write_recording(out, case.name, case.rows, case.readings, case.instrument, sensor, exact)
        (out / "base.txt").write_text(case.base + "\n", encoding="utf-8")
        truth = sealing.seal(
            folder / "truth" / f"{case.name}.json", case.truth, sealing.salt_of(seed, case.name)
        )
        files = [s / name for s in sessions for name in ("session.yaml", "indentations.csv")]
        hashes[case.name] = {"truth": truth, "recording": sealing.digest_of_files(*files)}
    published = {
        "format": "concealed-1",
        "seed": seed,
        "for": "development" if seed < DEVELOPMENT else "reporting",
        "commit": commit,
        "model_version": VERSION,
        "numbers": numbers,
        "bases": list(bases),
        "least_snr": least,
        "cases": hashes,
    }
    sealing.write(folder / SEALED, published)
    return published


def judge(
    folder: Path,
    command: str = COMMAND,
    limit: int | None = None,
    say: Callable[[str], None] = print,
    limit_s: int = 7200,
    workers: int = 1,
    base: str | None = None,
    names: Collection[str] | None = None,
) -> int:
    """Judge cases that have not been judged yet, at most `limit`, and return how many were; truths stay closed.

    The command may hold {recording}, {config}, {laws} (options), {out} and {kept} (a folder that all cases share).
    What it says goes to verdicts/<case>/log.txt. A case whose command fails has a verdict of nothing, which the scores
    count as a failure.
    workers: cases side by side. base: only the cases that stand on it. names: only these cases.
    """
    published = sealing.read(folder / SEALED)
    register = folder / REGISTER
    judged = sealing.read(register) if register.is_file() else {}
    todo = [name for name in published["cases"] if name not in judged and (names is None or name in names)]
    todo = [name for name in todo if base is None or base_config(folder, name).stem == base][:limit]
    with ThreadPoolExecutor(workers) as pool:
        running = {pool.submit(_judged, folder, name, command, limit_s): name for name in todo}
        for done in as_completed(running):
            name = running[done]
            judged[name] = done.result()
            sealing.write(register, judged)
            say(
                f"{name}: exit {judged[name]['code']}, {judged[name]['seconds']:.0f} s ({len(judged)} judged)"
            )
    return len(todo)


def _judged(folder: Path, name: str, command: str, limit_s: int) -> dict:
    """Judge one case and return the digest of its verdict, the seconds and the command's exit code."""
    out, began = folder / "verdicts" / name, time.perf_counter()
    code = run_judge(folder, name, base_config(folder, name), out, command, limit_s)
    return {
        "sha256": sealing.digest_of_files(*(out / file for file in JUDGED)),
        "seconds": round(time.perf_counter() - began, 1),
        "code": code,
    }


def base_config(folder: Path, name: str) -> Path:
    """Return the configuration that a case is judged against."""
    return CONFIG / f"{(folder / 'cases' / name / 'base.txt').read_text().strip()}.yaml"


def run_judge(folder: Path, name: str, config: Path, out: Path, command: str, limit_s: int) -> int:
    """Judge a case against a configuration into a folder and return the exit code, -1 where it took longer than limit_s."""
    out.mkdir(parents=True, exist_ok=True)
    places = {
        "recording": folder / "cases" / name,
        "config": config,
        "out": out,
        "kept": folder.parent / "kept",
    }
    words = [word.format(**places, laws="{laws}") for word in shlex.split(command)]
    laws = [word for path in LAWS.get(config.stem, []) for word in ("--laws", str(path))]
    words = [one for word in words for one in (laws if word == "{laws}" else [word])]
    with open(out / "log.txt", "w", encoding="utf-8") as log:
        try:
            return subprocess.run(words, stdout=log, stderr=subprocess.STDOUT, timeout=limit_s).returncode
        except subprocess.TimeoutExpired:
            return -1


def opened(folder: Path) -> list[dict]:
    """Return the judged cases with verdict and truth, both seals checked. Raises SealBroken."""
    published = sealing.read(folder / SEALED)
    judged = sealing.read(folder / REGISTER)
    found = []
    for name, seal in judged.items():
        out = folder / "verdicts" / name
        files = [out / file for file in JUDGED]
        sealing.check_files(seal["sha256"], *files)
        truth = sealing.opened(folder / "truth" / f"{name}.json", published["cases"][name]["truth"])
        truth = with_current_keys(truth)
        case = folder / "cases" / name
        recorded = [
            s / f
            for s in sorted((case / "recordings").iterdir())
            for f in ("session.yaml", "indentations.csv")
        ]
        sealing.check_files(published["cases"][name]["recording"], *recorded)
        verdict = with_current_keys(sealing.read(files[0])) if files[0].is_file() else None
        found.append({"name": name, "truth": truth, "verdict": verdict, "folder": out, "case": case, **seal})
    return found
