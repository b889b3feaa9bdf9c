"""A solved cell outlives its job, is taken up for equal inputs only, and is never used where it is damaged or not wanted."""

import os

import numpy as np
import pytest
from test_cell_file import invented_cell

from gelforge.indentation.cells import kept_solutions
from gelforge.indentation.cells.cell_file import read_cell
from gelforge.indentation.cells.kept_solutions import entries, forget, solved_once, tidy

INPUTS, OTHER = "a" * 64, "b" * 64


class Solves:
    """A solver that counts, and whose cells differ."""

    count = 0

    def __call__(self):
        self.count += 1
        cell = invented_cell()
        cell.arrays["depth_mm"] = np.array([0.5, float(self.count)])
        return cell


@pytest.fixture
def out(tmp_path):
    return tmp_path / "cells" / "x0_y0.h5"


@pytest.fixture
def lost(out):
    """A cell that was solved, and whose file the workflow manager has deleted."""
    solves = Solves()
    _, how = solved_once(out, INPUTS, solves)
    assert (solves.count, how) == (1, "solved")
    assert read_cell(out).arrays["depth_mm"][1] == 1
    out.unlink()
    return solves


def test_a_lost_cell_is_taken_up(out, lost):
    cell, how = solved_once(out, INPUTS, lost)
    assert lost.count == 1
    assert how.startswith("not solved again: taken up from")
    assert cell.arrays["depth_mm"][1] == read_cell(out).arrays["depth_mm"][1] == 1


def test_it_takes_the_disk_once_and_is_newer_than_its_inputs(out, lost):
    [entry] = entries(out)
    os.utime(entry, (0, 0))
    solved_once(out, INPUTS, lost)
    assert out.samefile(entry)
    assert out.stat().st_mtime > 1e9
    assert not list(out.parent.rglob("*.tmp*"))


def test_other_inputs_are_solved_and_replace_what_was_kept(out, lost):
    solved_once(out, OTHER, lost)
    assert lost.count == 2
    assert len(entries(out)) == 1
    out.unlink()
    solved_once(out, INPUTS, lost)
    assert lost.count == 3


def test_fresh_always_solves(out, lost):
    _, how = solved_once(out, INPUTS, lost, fresh=True)
    assert (lost.count, how) == (2, "solved anew, as asked")
    assert read_cell(out).arrays["depth_mm"][1] == 2
    out.unlink()
    solved_once(out, INPUTS, lost)
    assert (lost.count, read_cell(out).arrays["depth_mm"][1]) == (2, 2)


def test_what_is_damaged_is_solved_again(out, lost):
    [entry] = entries(out)
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 1  # one bit
    entry.write_bytes(content)
    _, how = solved_once(out, INPUTS, lost)
    assert lost.count == 2
    assert how.startswith("solved, as what was kept is damaged (")
    assert read_cell(out).arrays["depth_mm"][1] == 2


def test_without_hard_links_it_is_a_copy(out, monkeypatch):
    monkeypatch.setattr(kept_solutions.os, "link", refuse)
    solved_once(out, INPUTS, Solves())
    assert read_cell(out).converged
    assert not out.samefile(entries(out)[0])


def refuse(*_):
    raise OSError("no hard links here")


def test_forgotten_cells_are_solved_and_others_are_not(out, lost):
    other, solves = out.with_name("x0_y1.h5"), Solves()
    solved_once(other, INPUTS, solves)
    assert forget([out]) == 1
    other.unlink()
    solved_once(other, INPUTS, solves)
    solved_once(out, INPUTS, lost)
    assert (lost.count, solves.count) == (2, 1)


def test_tidying_keeps_what_is_still_needed(out, lost):
    other = out.with_name("x0_y1.h5")
    solved_once(other, INPUTS, Solves())
    tidy([out, other])
    assert (len(entries(out)), len(entries(other))) == (1, 0)
    solved_once(out, INPUTS, lost)
    tidy([out, other])
    assert not (out.parent / kept_solutions.FOLDER).exists()
    assert out.exists() and other.exists()
