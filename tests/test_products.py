"""Products that are whole or refused: checksums of every kind, what a killed process left, full disks, equal bytes."""

import json
import os
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from gelforge.files import (
    FileError,
    atomic,
    check_seal,
    read_product_json,
    read_product_table,
    seal,
    seals,
    temporary_beside,
    write_product_json,
    write_product_table,
)
from gelforge.hdf5 import opened, writing

REMEDY = "make it again"


def write_hdf5(path):
    with writing(path) as file:
        file.attrs["format"] = "numbers"
        file["values"] = np.arange(1000.0)


def write_npz(path):
    with atomic(path, sealed=True) as temporary:
        np.savez(temporary, values=np.arange(1000.0))


def write_table(path):
    write_product_table(path, pd.DataFrame({"cell": ["a", "b"], "force_N": [1.25, -3.5]}))


KINDS = {
    "values.h5": write_hdf5,
    "values.npz": write_npz,
    "law.json": lambda path: write_product_json(path, {"name": "gel", "mu_kPa": [1.0, 2.0]}),
    "readings.csv": write_table,
    "plain.csv": lambda path: path.write_text("force_N\n1.25\n-3.5\n"),
}
# of files whose sum another file holds: coreutils' sha256sum
STATED = {"plain.csv": "246077e329b9d5973eff364ee4703b9b3daaf5c1955046390752062ae738530e"}


def check(path):
    check_seal(path, REMEDY, stated=STATED.get(path.name))


@pytest.fixture(params=sorted(KINDS))
def product(request, tmp_path):
    path = tmp_path / request.param
    KINDS[request.param](path)
    return path


def test_a_whole_product_passes_and_its_bytes_repeat(product):
    check(product)
    first = product.read_bytes()
    KINDS[product.name](product)
    assert product.read_bytes() == first


def test_every_flipped_bit_is_noticed(product):
    whole, rng = product.read_bytes(), np.random.default_rng(1)
    for place in {0, len(whole) - 1, *rng.integers(0, len(whole), 40).tolist()}:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << int(rng.integers(8))
        product.write_bytes(damaged)
        with pytest.raises(FileError, match=rf"{product.name}: .*; {REMEDY}"):
            check(product)


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_cut_file_is_noticed(product, share):
    os.truncate(product, int(share * product.stat().st_size))
    with pytest.raises(FileError, match=REMEDY):
        check(product)


def test_products_are_read_elsewhere_sealed_anew_and_others_named(tmp_path):
    # Another program reads what is sealed
    for name, write in KINDS.items():
        write(tmp_path / name)
    with h5py.File(tmp_path / "values.h5") as file, np.load(tmp_path / "values.npz") as archive:
        assert np.array_equal(file["values"], archive["values"])
    assert json.loads((tmp_path / "law.json").read_text())["mu_kPa"] == [1.0, 2.0]
    plain = pd.read_csv(tmp_path / "readings.csv")
    assert plain["force_N"].tolist() == [1.25, -3.5]
    assert list(read_product_table(tmp_path / "readings.csv", REMEDY).columns) == ["cell", "force_N"]
    assert read_product_json(tmp_path / "law.json", REMEDY) == {"name": "gel", "mu_kPa": [1.0, 2.0]}

    # Who changes a product seals it anew
    write_hdf5(tmp_path / "values.h5")
    with h5py.File(tmp_path / "values.h5", "r+") as file:
        file["values"][3] = 7.0
    with pytest.raises(FileError, match="damaged or edited"):
        opened(tmp_path / "values.h5", "numbers", REMEDY)
    seal(tmp_path / "values.h5")
    with opened(tmp_path / "values.h5", "numbers", REMEDY) as file:
        assert file["values"][3] == 7.0

    # A file of another kind or none is named
    other = tmp_path / "other"
    other.mkdir()
    write_table(other / "a.h5")
    with pytest.raises(FileError, match=r"a\.h5: no HDF5 file; make it again"):
        opened(other / "a.h5", "numbers", REMEDY)
    os.mkfifo(other / "pipe.h5")
    for name, words in (("pipe.h5", "no regular file"), ("none.h5", "no such file")):
        with pytest.raises(FileError, match=words):
            opened(other / name, "numbers", REMEDY)


# ---------------------------------------------------------------------------------- the machine, not the file
@pytest.mark.parametrize(
    ("number", "words"),
    [
        (13, "permission denied"),
        (24, "too many files are open"),
        (116, "lost its handle"),
        (5, "cannot be read"),
    ],
)
def test_an_intact_file_is_never_to_be_deleted(tmp_path, monkeypatch, number, words):
    write_hdf5(tmp_path / "values.h5")

    def fail(*_):
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(seals, "_seal_place", fail)
    with pytest.raises(FileError, match=words) as refused:
        check_seal(tmp_path / "values.h5", REMEDY)
    assert "delete" not in str(refused.value)
    assert REMEDY not in str(refused.value)


def test_a_lock_that_is_refused_is_not_the_file(tmp_path, monkeypatch):
    write_hdf5(tmp_path / "values.h5")

    def fail(*_):
        raise OSError(
            "Unable to synchronously open file (unable to lock file, errno = 37, error message = 'No')"
        )

    monkeypatch.setattr(h5py, "File", fail)
    with pytest.raises(FileError, match=r"cannot be opened.*HDF5_USE_FILE_LOCKING=FALSE"):
        opened(tmp_path / "values.h5", "numbers", REMEDY)


def test_a_full_disk_leaves_what_was_there(tmp_path):
    write_hdf5(tmp_path / "values.h5")
    before = (tmp_path / "values.h5").read_bytes()
    code = f"""
import resource, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import numpy as np
from gelforge.files import FileError, write_text
from gelforge.hdf5 import writing
resource.setrlimit(resource.RLIMIT_FSIZE, (20000, 20000))
for attempt in range(2):
    try:
        if attempt:
            write_text("{tmp_path}/long.txt", "x" * 30000)
        with writing("{tmp_path}/values.h5") as file:
            file["names"] = [f"name {{k}}" for k in range(500)]
            data = file.create_dataset("rows", (0, 100), "f8", maxshape=(None, 100), chunks=(1, 100), compression="gzip")
            for row in range(300):  # as a shard grows: HDF5 itself cannot close such a file on a full disk
                data.resize(row + 1, axis=0)
                data[row] = np.random.default_rng(row).normal(size=100)
    except FileError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert len(lines) == 2
    assert "values.h5: not written, the file is larger than the limit" in lines[0]
    assert "long.txt: not written" in lines[1]
    assert (tmp_path / "values.h5").read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["values.h5"]


# ------------------------------------------------------------------------------------- what a killed process left
KILLED = """
import os, signal, sys
from gelforge.files import atomic
with atomic(sys.argv[1]) as temporary:
    temporary.write_text("half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_the_next_run_removes_what_a_killed_one_left(tmp_path):
    killed = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path / "a.csv")])
    assert killed.returncode == -9
    assert len(list(tmp_path.iterdir())) == 1
    alive = temporary_beside(tmp_path / "b.csv")  # of this process: it may still be written to
    alive.write_text("at work")
    elsewhere = tmp_path / ".c.other_machine-1-2.tmp.csv"
    elsewhere.write_text("perhaps at work")
    old = tmp_path / ".d.other_machine-1-2.tmp.csv"
    old.write_text("of the day before yesterday")
    os.utime(old, (0, 0))
    folder = tmp_path / old.name.replace(".csv", "").replace(".d.", ".session.")
    (folder / "images").mkdir(parents=True)
    os.utime(folder, (0, 0))
    mine = tmp_path / ".notes.tmp"
    mine.write_text("somebody's own")
    write_table(tmp_path / "a.csv")
    assert {path.name for path in tmp_path.iterdir()} == {"a.csv", alive.name, elsewhere.name, mine.name}

    # A process of the same number that started later is another
    later = tmp_path / "later"
    later.mkdir()
    machine, process, started = temporary_beside(later / "a").name.split(".")[2].split("-")
    left = later / f".a.{machine}-{process}-{int(started) - 1}.tmp"
    left.write_text("half")
    write_table(later / "b.csv")
    assert not left.exists()
