"""The parts of the network's error in words and bars, and what is said where no truth is known."""

from types import SimpleNamespace

import pytest
from fake_tables import error_budget
from matplotlib.text import Text

from gelforge.report.chapters.chapter import Chapter
from gelforge.report.chapters.error_budget import BARS, budget_figure, budget_words, tell_budget


@pytest.mark.parametrize(
    ("sizes", "words"),
    [
        (
            {},
            [
                "13 mN, and the largest part is mechanics: 12 mN (optics 4 mN, learning 3 mN)",
                "0.28 px (0.022 mm)",
            ],
        ),
        ({"mechanics": 0.001}, ["of a pressed bin it is 5.1 mN, and the largest part is optics: 4 mN"]),
        # of totals learning is twice as large
        (
            {"mechanics": 0.001},
            ["the largest part is learning: 0.06 N", "of a pressed bin: a sharper", "in total: more sites."],
        ),
        ({"optics": 0.03}, ["the largest part is optics: 30 mN", "lower both: a sharper or nearer camera"]),
    ],
)
def test_the_largest_part_is_named_with_what_would_help(sizes, words):
    said = budget_words(error_budget(**sizes))
    for word in words:
        assert word in said, said


def test_bars_are_the_parts_at_one_scale_and_remedies_follow_them():
    # Bars are the parts in mN and N at one scale
    figure = budget_figure(error_budget())
    figure.canvas.draw()
    bins, total = figure.axes
    assert [bar.get_width() for bar in bins.patches] == pytest.approx([4, 3, 12, 13])
    assert [bar.get_width() for bar in total.patches] == pytest.approx([0.04, 0.06, 0.12, 0.13])
    inches = [ax.get_window_extent().width / ax.get_xlim()[1] for ax in figure.axes]
    assert 1e3 * inches[0] == pytest.approx(inches[1], rel=0.02)
    for ax, unit in zip(figure.axes, ("[mN]", "[N]")):
        assert ax.get_xlim()[0] == 0
        assert unit in ax.get_xlabel()
    words = "\n".join(artist.get_text() for artist in figure.findobj(Text))
    for name, _ in BARS.values():
        assert name in words

    # The remedy of a small part is not given
    assert "more sites" not in budget_words(error_budget())
    assert "material tests" not in budget_words(error_budget(mechanics=0.001))

    # A table without a pressed row is not drawn
    empty = error_budget()
    empty[empty.columns[1:]] = float("nan")
    chapter = Chapter("predictions", "Predictions")
    tell_budget(chapter, SimpleNamespace(table=lambda name: empty, study=SimpleNamespace(virtual_lab=None)))
    assert chapter.blocks == []


@pytest.mark.parametrize(
    ("virtual_lab", "missing", "words"),
    [
        (None, False, "needs recordings whose true forces"),
        ("lab.yaml", True, "error_budget.csv is not there"),
    ],
)
def test_without_a_table_the_reason_is_one_line(tmp_path, virtual_lab, missing, words):
    study = SimpleNamespace(virtual_lab=virtual_lab)
    chapter = Chapter("predictions", "Predictions")
    tell_budget(chapter, SimpleNamespace(table=lambda name: None, study=study, folder=tmp_path))
    (note,) = chapter.blocks
    assert words in note.words
    assert note.missing == missing
