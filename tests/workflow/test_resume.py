"""What a broken-off run has solved is taken up again, unless the user forces the job; the log says which."""

import base64

import pytest

from gelforge.cli import main

pytestmark = pytest.mark.workflow
TEST = ("--cores", "1", "--configfile", "config/test.yaml")
CELL = "results/test/cells/x1_y1.h5"
LAWS = [f"results/test/materials/{name}/law.json" for name in ("ecoflex_gel", "elastosil_25_1")]


def solve(*more):
    return main(
        ["simulate", "--study", "config/test.yaml", "--cell", "x1_y1", "--laws", *LAWS, "--out", CELL, *more]
    )


def outcome(checkout) -> str:
    return (checkout.folder / "logs/test/cells/x1_y1.log").read_text()


def kept(checkout) -> list:
    return list((checkout.folder / "results/test/cells").glob(".solved/*"))


def test_taken_up_after_an_interruption_and_solved_anew_when_forced(checkout, monkeypatch, capsys):
    checkout.snakemake(*LAWS, *TEST)
    monkeypatch.chdir(checkout.folder)
    assert solve() == 0  # as a job does whose run ends before it accepts the file
    assert "converged; solved\n" in capsys.readouterr().out
    before = (checkout.folder / CELL).read_bytes()

    (checkout.folder / CELL).unlink()  # as of a group that failed
    checkout.snakemake(CELL, *TEST)
    assert "converged; not solved again: taken up from" in outcome(checkout)
    assert (checkout.folder / CELL).read_bytes() == before
    assert kept(checkout) == [], "a run that ended well leaves nothing"

    assert solve() == 0
    marks = checkout.folder / ".snakemake/incomplete"  # as of a run that was killed
    marks.mkdir(exist_ok=True)
    (marks / base64.b64encode(CELL.encode()).decode()).touch()
    checkout.snakemake(CELL, *TEST)
    assert "taken up from" in outcome(checkout)

    for force in (("-R", CELL), ("--force",)):
        assert solve() == 0
        printed = checkout.snakemake(CELL, *TEST, *force).stdout
        assert "forced: 1 kept solutions removed, they are solved anew" in printed
        assert outcome(checkout).endswith("converged; solved\n"), force

    capsys.readouterr()
    assert solve() == 0
    assert solve("--fresh") == 0
    assert "converged; solved anew, as asked" in capsys.readouterr().out
