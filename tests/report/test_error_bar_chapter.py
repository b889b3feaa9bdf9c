"""The error bars of the labels in the report: the band is two sigma wide, relative sigmas are over the force itself."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from edited_file import edited

from gelforge.report.chapters.error_bar_chapter import error_bar_figure, error_bars, sigma_table
from gelforge.report.chapters.results_reader import SIGMAS, StudyResults

# Two sites at two depths: forces, and sigmas of which the shares are easily seen.
ROWS = pd.DataFrame(
    {
        "cell": ["a", "a", "b", "b"],
        "depth": [0.5, 1.0, 0.5, 1.0],
        "force": [0.1, 0.4, 0.2, 0.5],
        "mesh": [0.003, 0.004, 0.002, 0.015],
        "constitutive models": [0.004, 0.003, 0.001, 0.020],
    }
)


def test_table_and_band_are_of_both_parts():
    table = sigma_table(ROWS).set_index("depth [mm]")
    assert list(table["sites"]) == [2, 2]
    np.testing.assert_allclose(
        table.loc["0.5", ["mesh, median [%]", "mesh, largest [%]"]].tolist(), [2.0, 3.0]
    )
    np.testing.assert_allclose(
        table.loc["1", ["constitutive models, median [%]", "constitutive models, largest [%]"]].tolist(),
        [2.375, 4.0],
    )

    # Band is two sigma of both parts to each side
    figure = error_bar_figure(ROWS[ROWS.cell == "a"], "centre")
    vertices = figure.axes[0].collections[0].get_paths()[0].vertices
    at_first = vertices[np.isclose(vertices[:, 0], 0.5), 1]
    # 3-4-5: sigma 0.005 N at the first depth
    np.testing.assert_allclose([at_first.min(), at_first.max()], [0.09, 0.11])


def test_chapter_names_the_laws_of_which_nothing_is_known_or_the_missing_bars(whole):
    chapter = error_bars(StudyResults(*whole))
    picture, table = chapter.blocks
    assert (
        "the constitutive models of ecoflex_gel are is not known" in picture.words
        and "elastosil" not in picture.words
    )
    # 24 of 25 cells converged; sigmas are 1 % and 0.4 % of the force in all of them
    assert table.rows[0] == ["0.5", "24", "1", "1", "0.4", "0.4"]

    # A study without error bars says so
    study = whole[0].model_copy(
        update={"mechanics": whole[0].mechanics.model_copy(update={"error_bars": False})}
    )
    (note,) = error_bars(replace(StudyResults(*whole), study=study)).blocks
    assert not note.missing and "mechanics.error_bars: false" in note.words


@pytest.mark.parametrize("lacking", sorted(SIGMAS.values()))
def test_cells_without_error_bars_are_told(whole, tmp_path, lacking):
    shutil.copytree(whole[1] / "cells", tmp_path / "cells")
    for path in (tmp_path / "cells").glob("*.h5"):
        with edited(path) as file:
            del file[lacking]
    results = replace(StudyResults(*whole), folder=tmp_path)
    (note,) = error_bars(results).blocks
    assert note.missing and "no solved site holds any" in note.words
