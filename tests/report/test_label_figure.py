"""`gelforge show`: a label of a cell or of a shard."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from matplotlib.text import Text

from gelforge.files import write_product_json
from gelforge.hdf5 import writing
from gelforge.report.figures.simulation.label_figure import LabelError, label_figure, read_label


@pytest.fixture
def shard(tmp_path):
    """A shard of two rows; the second is untouched."""
    path = tmp_path / "shard-00000.h5"
    force = np.zeros((2, 12, 3), np.float32)
    force[0, 7] = [0.01, 0.0, -0.2]
    text = h5py.string_dtype()
    with writing(path) as file:
        file.attrs["format"] = "gelforge-shard-2"
        file["force_distribution_N"] = force
        file["position_mm"] = [[7.0, 3.0], [7.0, 3.0]]
        file["depth_mm"] = [1.0, 0.0]
        file["untouched"] = [False, True]
        file["image_index"] = [2, 0]
        for key, values in {"cell": ["c", "c"], "session": ["day1"] * 2, "press": ["p1", "p0"]}.items():
            file.create_dataset(key, data=values, dtype=text)
    sensor = {"width_x_mm": 8.0, "width_y_mm": 6.0, "bins": {"nx": 4, "ny": 3}}
    write_product_json(tmp_path / "manifest.json", {"settings": {"sensor": sensor}})
    return path


def test_cell_label_defaults_to_the_deepest_and_shows_totals_and_frame(whole):
    label = read_label(whole[1] / "cells" / "x4_y2.h5")
    assert label.depth_mm == 2.0
    assert label.position_mm == (27.0, 16.0)
    assert label.widths_mm == (32.0, 32.0)
    shallow = read_label(whole[1] / "cells" / "x4_y2.h5", 0)
    assert shallow.depth_mm == 0.5
    assert shallow.bin_force_N[:, 2].sum() > label.bin_force_N[:, 2].sum()  # both negative

    # Label figure shows totals units and frame
    path = whole[1] / "cells" / "x4_y2.h5"
    figure = label_figure(path)
    words = [artist.get_text() for artist in figure.findobj(Text)]
    total = read_label(path).bin_force_N[:, 2].sum()
    assert f"$F_z$  total {total:+.3f} N" in words
    assert words.count("[N per bin]") == 3
    assert {"x [mm]", "y [mm]"} <= set(words) and any("z towards the viewer" in word for word in words)
    low, high = figure.axes[2].collections[0].get_clim()
    assert low == -high


def test_shard_rows_need_their_manifest_and_an_unrolled_dome_marks_its_surface(shard):
    # Shard row needs its manifest
    label = read_label(shard, 0)
    assert label.bins == (4, 3)
    assert label.widths_mm == (8.0, 6.0)
    assert "session day1, press p1, image 2" in label.title
    assert "untouched" in read_label(shard, 1).title
    figure = label_figure(shard, 1)  # an all-zero label draws too
    title = figure.get_suptitle()
    figure.draw_without_rendering()
    assert "shard-00000.h5 row 1" in title
    assert figure._suptitle.get_window_extent().width < figure.bbox.width  # a long title is not cut

    # Shard without manifest
    (shard.parent / "manifest.json").unlink()
    with pytest.raises(LabelError, match=r"manifest.json: no such file; it says how large the sensor"):
        read_label(shard, 0)

    # The label of an unrolled dome is marked where its position lies on the surface
    layers = [{"name": "gel", "thickness_mm": 3.0, "material": "soft"}]
    shape, bins = {"kind": "dome"}, {"nx": 4, "ny": 3, "over": "surface"}
    sensor = {
        "width_x_mm": 8.0,
        "width_y_mm": 6.0,
        "wall_mm": 0.0,
        "layers": layers,
        "shape": shape,
        "bins": bins,
    }
    write_product_json(shard.parent / "manifest.json", {"settings": {"sensor": sensor}})
    label = read_label(shard, 0)
    assert (
        label.position_mm == (7.0, 3.0) and 6.0 < label.unrolled_mm[0] < 7.0
    )  # nearer the middle than from above
    assert label.unrolled_mm[1] == pytest.approx(3.0)
    figure = label_figure(shard, 0)
    assert "surface unrolled" in figure.get_suptitle()
    assert figure.axes[0].get_xlabel() == "x along the surface [mm]"


@pytest.mark.parametrize("row", [2, -3])
def test_row_out_of_range_names_the_limit(shard, row):
    with pytest.raises(LabelError, match=f"row {row} of 2; give 0 to 1"):
        read_label(shard, row)


def test_files_that_hold_no_label(tmp_path, whole):
    with pytest.raises(LabelError, match="no such file"):
        read_label(tmp_path / "none.h5")
    (tmp_path / "cut.h5").write_bytes(b"\x89HDF cut")
    with pytest.raises(LabelError, match="(holds no checksum|damaged or edited)"):
        read_label(tmp_path / "cut.h5")
    with pytest.raises(LabelError, match="neither a site"):
        read_label(whole[1] / "features" / "day1.h5")
