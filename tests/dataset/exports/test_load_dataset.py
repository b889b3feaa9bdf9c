"""`gelforge.load_dataset`: PyTorch rows of each split, as the shards hold them."""

import pytest
import torch
from numpy.testing import assert_array_equal

import gelforge
from gelforge.dataset.exports.images import pixels
from gelforge.dataset.exports.source import SPLITS
from gelforge.dataset.schema import DatasetError


def test_rows_are_those_of_the_shards(made_once, expected):
    loaded = gelforge.load_dataset(made_once.folder, images=True)
    assert list(loaded) == list(SPLITS)
    for split, rows in loaded.items():
        wanted = expected[split]
        assert len(rows) == len(wanted["cell"])
        for number in (0, len(rows) - 1):
            row = rows[number]
            assert set(row) == set(wanted)
            for name, values in wanted.items():
                if name == "image":
                    assert_array_equal(row[name].numpy(), pixels(values[number]).transpose(2, 0, 1))
                elif isinstance(row[name], str):
                    assert row[name] == values[number]
                else:
                    assert_array_equal(row[name].numpy(), values[number])


def test_a_loader_with_workers_gives_whole_batches(made_once, expected):
    rows = gelforge.load_dataset(made_once.folder, "train", ["feature", "force_distribution_N", "cell"])
    loader = torch.utils.data.DataLoader(rows, batch_size=5, num_workers=1)
    batches = list(loader)
    assert batches[0]["force_distribution_N"].shape == (5, 25, 3)
    assert_array_equal(torch.cat([b["feature"] for b in batches]).numpy(), expected["train"]["feature"])
    assert [name for b in batches for name in b["cell"]] == expected["train"]["cell"].tolist()


def test_the_card_says_how_to_load_and_what_does_not_exist_is_refused(made_once, tmp_path):
    # The card says how to load. The ten lines of the card run as they stand
    text = (made_once.folder / "README.md").read_text()
    code = text.split("```python\n")[1].split("```")[0]
    assert 8 <= len(code.strip().splitlines()) <= 11
    exec(code.replace("FOLDER", str(made_once.folder)), {})

    # What does not exist is refused
    with pytest.raises(DatasetError, match="no split 'valid'"):
        gelforge.load_dataset(made_once.folder, "valid")
    with pytest.raises(DatasetError, match=r"no columns \['force'\]"):
        gelforge.load_dataset(made_once.folder, "train", ["force"])
    with pytest.raises(DatasetError, match=r"no dataset with manifest\.json"):
        gelforge.load_dataset(tmp_path, "train")
