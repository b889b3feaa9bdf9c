"""The solutions that are kept next to the generator: all of them, and what is written is read again."""

from concurrent.futures import Future

import numpy as np
import pytest

pytest.importorskip("felupe", reason="FElupe is not installed: pip install -e .[verification]")
from validation import solves
from validation.library import load_library
from validation.pressed import Curve
from validation.sensors import SMALL, WIDE


def test_every_solution_that_a_set_needs_is_kept(monkeypatch):
    """Of the sensors of which a set has been sealed."""
    sealed = {"small": SMALL, "wide": WIDE}
    monkeypatch.setattr(solves, "SENSORS", sealed)
    found = solves.read_solutions()
    assert not [name for name, setup in solves.all_setups() if setup not in found]
    for sensor in sealed.values():
        library = load_library(found, sensor)
        assert set(library.changes) == set(sensor.effects) - {"slipping"}  # which tells what no slip would be
        defects = solves.DEFECTS if sensor == SMALL else ()
        assert {name for name, _ in library.defects} == set(defects)


def test_a_curve_is_read_as_it_was_written(tmp_path):
    setup = solves.effect_setup("friction", 4.0, 2.0)
    rng = np.random.default_rng(1)
    curve = Curve(np.array(setup.depths_mm), rng.normal(size=(5, 3)), rng.random(5), 12.3, 4000, 40)
    path = tmp_path / "solutions.jsonl"
    path.write_text(solves.line_of(setup, curve) + "\n", encoding="utf-8")
    found = solves.read_solutions(path)
    for name in ("depths_mm", "force_N", "area_mm2"):
        assert np.array_equal(getattr(found[setup], name), getattr(curve, name))
    assert (found[setup].seconds, found[setup].unknowns, found[setup].iterations) == (12.3, 4000, 40)
    with pytest.raises(KeyError, match="has not been solved"):
        found[solves.effect_setup("friction", 6.0, 6.0)]


def solved_again(tmp_path, monkeypatch, done):
    """Return the file, the setups asked for and what was said when all but one press is known, and that one is `done`."""
    path = tmp_path / "solutions.jsonl"
    lines = solves.SOLUTIONS.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[1:]) + "\n", encoding="utf-8")
    asked, said = [], []

    class AtOnce:
        def __init__(self, *_, **__): ...
        def __enter__(self):
            return self

        def __exit__(self, *_): ...
        def submit(self, _, setup):
            asked.append(setup)
            return done

    monkeypatch.setattr(solves, "ProcessPoolExecutor", AtOnce)
    monkeypatch.setattr(solves, "as_completed", list)
    monkeypatch.setattr(solves, "SENSORS", {"small": SMALL})
    solves.solve_all(path, say=said.append)
    return path, asked, said


def test_solving_goes_on_where_it_was_left_and_tells_what_cannot_be_solved(tmp_path, monkeypatch):
    # Solving goes on where it was left. One press is left out of the file; it alone is solved and added, by a press
    # that is cut short here
    left_out = solves.base_setup(0.0, 0.0)
    done = Future()
    done.set_result(solves.read_solutions()[left_out])
    path, asked, said = solved_again(tmp_path, monkeypatch, done)
    assert asked == [left_out] and len(said) == 1
    assert np.array_equal(solves.read_solutions(path)[left_out].force_N, done.result().force_N)

    # A press that cannot be solved is reported and not kept
    failed = Future()
    failed.set_exception(ValueError("no equilibrium at 1.85 mm"))
    path, asked, said = solved_again(tmp_path, monkeypatch, failed)
    assert asked[0] not in solves.read_solutions(path)
    assert said == ["small: base (0, 0): not solved: no equilibrium at 1.85 mm"]
