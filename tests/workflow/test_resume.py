"""What a broken-off run has solved is taken up again, unless the user forces the job; the log says which."""

import base64

import pytest

from gelforge.cli import main

pytestmark = pytest.mark.workflow
TEST = ("--cores", "1", "--configfile", "config/test.yaml")
CELL = "results/test/cells/x1_y1.h5"
FOLDERS = {name: f"results/test/materials/{name}" for name in ("ecoflex_gel", "elastosil_25_1")}
LAWS = [f"{folder}/law.json" for folder in FOLDERS.values()]


def solve(*more):
    return main(
        ["simulate", "--study", "config/test.yaml", "--cell", "x1_y1", "--laws", *LAWS, "--out", CELL, *more]
    )


def outcome(checkout) -> str:
    return (checkout.folder / "logs/test/cells/x1_y1.log").read_text()


def kept(checkout) -> list:
    return list((checkout.folder / "results/test/cells").glob(".solved/*"))


@pytest.fixture
def ready(checkout, monkeypatch):
    """Return a checkout with laws, in which this process is and the cell is cheap."""
    checkout.coarsen()
    monkeypatch.chdir(checkout.folder)
    for name, folder in FOLDERS.items():
        assert main(["fit-law", "--study", TEST[-1], "--material", name, "--out", folder]) == 0
    return checkout


def test_taken_up_after_an_interruption(ready, capsys):
    capsys.readouterr()
    assert solve() == 0  # as a job does whose run ends before it accepts the file
    assert "converged; solved\n" in capsys.readouterr().out
    before = (ready.folder / CELL).read_bytes()

    (ready.folder / CELL).unlink()  # as of a group that failed
    ready.snakemake(CELL, *TEST)
    assert "converged; not solved again: taken up from" in outcome(ready)
    assert (ready.folder / CELL).read_bytes() == before
    assert kept(ready) == [], "a run that ended well leaves nothing"

    assert solve() == 0
    marks = ready.folder / ".snakemake/incomplete"  # as of a run that was killed
    marks.mkdir(exist_ok=True)
    (marks / base64.b64encode(CELL.encode()).decode()).touch()
    ready.snakemake(CELL, *TEST)
    assert "taken up from" in outcome(ready)


@pytest.mark.thorough(but_first=1)
@pytest.mark.parametrize("force", [("-R", CELL), ("--force",)], ids=lambda force: force[0])
def test_solved_anew_when_forced(ready, force):
    assert solve() == 0
    printed = ready.snakemake(CELL, *TEST, *force).stdout
    assert "forced: 1 kept solutions removed, they are solved anew" in printed
    assert outcome(ready).endswith("converged; solved\n")


def test_solved_anew_when_asked(ready, capsys):
    assert solve() == 0
    assert solve("--fresh") == 0
    assert "converged; solved anew, as asked" in capsys.readouterr().out
