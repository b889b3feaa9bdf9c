"""fTetWild (Hu et al. 2020, doi 10.1145/3386569.3392385) through pytetwild's compiled module, repeatable to the byte.

Two things make its meshes differ from call to call even with one thread: the order in which it inserts triangles is shuffled
by a generator seeded from std::random_device, and another generator keeps its state between calls. So every mesh is made
in a process of its own, in which the reads of that device return a constant. The package around the compiled module
asks for PyVista as soon as it is imported (0.4.2), although the module itself needs NumPy only: it is loaded without it.
"""

from __future__ import annotations

import ctypes
import functools
import importlib.machinery
import importlib.util
import io
import itertools
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

# The default seed of the Mersenne twister (Matsumoto & Nishimura 1998, doi 10.1145/272991.272995; C++ 2011).
SEED = 5489
RANDOM_READ = b"_ZNSt13random_device9_M_getvalEv"  # std::random_device::operator() of libstdc++
# The mean quality at which fTetWild stops improving, its own default (Hu et al. 2020).
STOP_ENERGY = 10.0


class TetwildError(ValueError):
    """fTetWild made no mesh: what it said in one line, what to do."""


def tetrahedralize(
    vertices: np.ndarray,
    triangles: np.ndarray,
    size: Callable[[np.ndarray], np.ndarray],
    largest: float,
    envelope: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes (N, 3) [mm] and tetrahedra (E, 4), positively oriented, of the box around triangles (T, 3).

    The triangles may cross and coincide; faces of the mesh follow them within the envelope [mm]. size maps points (n, 3)
    to the edge length wanted there [mm], at most `largest`. What lies outside every surface is part of the mesh.
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    points, tetrahedra = _background(low - 2 * largest, high + 2 * largest)
    job = io.BytesIO()
    np.savez(
        job,
        vertices=np.ascontiguousarray(vertices, dtype=float),
        triangles=triangles.astype(np.uint32),
        largest=largest,
        envelope=envelope / np.linalg.norm(high - low),
        points=points,
        tetrahedra=tetrahedra.astype(np.int32),
        size=np.minimum(size(points), largest),
    )
    return _meshed(job.getvalue())


# a verdict solves its sites again and again, with other parameters on the same mesh
@functools.lru_cache(maxsize=16)
def _meshed(content: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Return the read-only nodes and tetrahedra that a process of its own makes of a job's file."""
    with tempfile.TemporaryDirectory(prefix="gelforge-mesh-") as folder:
        job, made = Path(folder) / "job.npz", Path(folder) / "mesh.npz"
        job.write_bytes(content)
        command = [sys.executable, "-m", "gelforge.meshing.tetwild", str(job), str(made)]
        paths = [str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")]
        own = {"OMP_NUM_THREADS": "1", "PYTHONPATH": os.pathsep.join(filter(None, paths))}
        done = subprocess.run(command, capture_output=True, text=True, env=os.environ | own)
        if done.returncode or not made.is_file():
            raise TetwildError(
                f"fTetWild made no mesh (exit {done.returncode}): {_last_words(done.stderr)}; check that the surfaces do "
                "not cross themselves, or ask for larger mechanics.mesh.near_mm and far_mm"
            )
        with np.load(made) as mesh:
            nodes, tetrahedra = mesh["nodes"].astype(float), mesh["tetrahedra"].astype(np.int64)
    tetrahedra = tetrahedra[:, [0, 2, 1, 3]]  # fTetWild's own orientation is the opposite one
    for array in (nodes, tetrahedra):
        array.setflags(write=False)  # each caller gets the same arrays
    return nodes, tetrahedra


def _last_words(said: str) -> str:
    """Return the end of what a process said on one line, and what it means where its memory did not suffice."""
    words = " ".join(said.split())[-200:] or "it said nothing"
    return f"{words}, too little memory" if "bad_alloc" in words else words


def _background(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points and tetrahedra (six to a cell) of a regular grid of a box, on which sizes are given."""
    # 40 intervals along the longest side
    n = np.maximum(np.ceil(40 * (high - low) / (high - low).max()).astype(int), 2)
    lines = [np.linspace(a, b, m + 1) for a, b, m in zip(low, high, n)]
    points = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
    cell = np.stack(np.meshgrid(*[np.arange(m) for m in n], indexing="ij"), axis=-1).reshape(-1, 3)
    parts = []
    # Kuhn's six: one path along the axes from corner to corner each
    for order in itertools.permutations(range(3)):
        path = np.cumsum([np.zeros(3, int), *np.eye(3, dtype=int)[list(order)]], axis=0)
        corners = np.stack([np.ravel_multi_index((cell + step).T, tuple(n + 1)) for step in path], axis=-1)
        even = np.linalg.det(np.eye(3)[list(order)]) > 0
        parts.append(corners if even else corners[:, [0, 1, 3, 2]])
    return points, np.concatenate(parts)


# --------------------------------------------------------------------------------------- the mesher's own process
def _compiled_module():
    """Return pytetwild's compiled module without the package around it."""
    package = importlib.util.find_spec("pytetwild")
    if package is None:
        raise TetwildError("pytetwild is not installed; pip install pytetwild")
    name = "PyfTetWildWrapper"
    folders = list(package.submodule_search_locations or [])
    spec = importlib.machinery.PathFinder.find_spec(name, folders)
    if spec is None or spec.loader is None:
        raise TetwildError(f"pytetwild has no compiled module {name} in {folders}; install it again")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _fix_random_device(library: str):
    """Let the loaded ELF library's calls of std::random_device return SEED; return what must be kept alive.

    The library calls it through a slot of its own table of addresses; the slot is overwritten. Raises TetwildError where
    the library has none: its meshes would not repeat.
    """
    content = Path(library).read_bytes()
    if content[:6] != b"\x7fELF\x02\x01":
        raise TetwildError(
            f"{library} is no 64-bit ELF library; meshes repeat on Linux only, make them there"
        )
    slot = _slot_of(content, RANDOM_READ)
    with open("/proc/self/maps") as maps:
        base = next(int(line.split("-")[0], 16) for line in maps if line.rstrip().endswith(library))
    constant = ctypes.CFUNCTYPE(ctypes.c_uint, ctypes.c_void_p)(lambda device: SEED)
    ctypes.c_void_p.from_address(base + slot).value = ctypes.cast(constant, ctypes.c_void_p).value
    return constant


def _slot_of(content: bytes, symbol: bytes) -> int:
    """Return the address, relative to the library's start, of the slot through which an ELF library calls a symbol."""
    (table,), (width, count) = struct.unpack_from("<Q", content, 40), struct.unpack_from("<HH", content, 58)
    fields = ("name", "type", "flags", "address", "offset", "size", "link", "info", "align", "entry")
    sections = [
        dict(zip(fields, struct.unpack_from("<IIQQQQIIQQ", content, table + width * k))) for k in range(count)
    ]
    # SHT_RELA: (address, symbol and kind, addend)
    for relocations in (s for s in sections if s["type"] == 4):
        symbols = sections[relocations["link"]]
        if symbols["entry"] != 24:
            continue
        strings = sections[symbols["link"]]["offset"]
        entries = np.frombuffer(content, "<u8", relocations["size"] // 8, relocations["offset"])
        for address, info, _ in entries.reshape(-1, 3).tolist():
            number = info >> 32
            if number:
                (name,) = struct.unpack_from("<I", content, symbols["offset"] + 24 * number)
                if content.startswith(symbol + b"\0", strings + name):
                    return address
    raise TetwildError(f"no call of {symbol.decode()} found in fTetWild's library; use pytetwild 0.4.2")


def _mesh(job: str, made: str) -> None:
    module = _compiled_module()
    kept = _fix_random_device(str(Path(module.__file__).resolve()))
    with np.load(job) as given:
        nodes, tetrahedra = module.tetrahedralize_mesh(
            given["vertices"], given["triangles"],
            True,  # optimise: without it sizes are not used
            False,  # simplify the surface within the envelope first
            0.05, float(given["largest"]), float(given["envelope"]), STOP_ENERGY,
            False,  # do not coarsen
            1,  # thread
            80,  # its usual number of passes
            6, True,  # say nothing
            False,  # its own order of nodes
            True,  # keep what lies outside: the caller decides by distance
            given["points"], given["tetrahedra"], given["size"],
        )  # fmt: skip
    del kept
    np.savez(made, nodes=nodes, tetrahedra=tetrahedra)


if __name__ == "__main__":
    _mesh(*sys.argv[1:])
