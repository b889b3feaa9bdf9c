"""robomimic: one HDF5 file with a demonstration per indentation and masks for the splits."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np

from gelforge.dataset.exports.card import card
from gelforge.dataset.exports.export import Export, Options
from gelforge.dataset.exports.images import pixels
from gelforge.dataset.exports.source import SPLITS, Press, Source
from gelforge.files import write_text
from gelforge.hdf5 import writing
from gelforge.progress import tracked

MASKS = {"train": "train", "validation": "valid", "test": "test"}  # as robomimic names them
FILE = "demonstrations.hdf5"
USE = """\
```python
import h5py

file = h5py.File("FOLDER/demonstrations.hdf5")
names = file["mask/train"].asstr()[:]  # or mask/valid, mask/test
file["data"][names[0]]["obs/force_distribution_N"][:]  # (images, {label}) [N]
```

`data/<demo>/actions` are the planned position x, y and depth [mm] of each row; `obs` holds the columns below, `image` as
pixels. Text of a row (`cell`, `phase`, `image_file`) is in `data/<demo>/about`. robomimic reads a split with
`hdf5_filter_by_attribute="train"`."""


def write(source: Source, folder: Path, options: Options) -> None:
    """Write the file and its card."""
    with writing(folder / FILE) as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(source.counts.values())
        data.attrs["env_args"] = json.dumps({"env_name": "gelforge", "type": 1, "env_kwargs": {}})
        about = {name: [v.unit, v.description] for name, v in source.variables.items()}
        # once: on every dataset they would outweigh small indentations
        data.attrs["columns"] = json.dumps(about)
        data.attrs["manifest_sha256"] = source.manifest_sha256
        for number, press in enumerate(tracked(source.presses, "indentations exported")):
            _write_press(data.create_group(f"demo_{number}"), source, press)
        for split in SPLITS:
            names = [f"demo_{n}" for n, press in enumerate(source.presses) if press.split == split]
            file.create_dataset(f"mask/{MASKS[split]}", data=np.array(names, "S"))
    label = ", ".join(map(str, source.variables["force_distribution_N"].shape))
    write_text(folder / "README.md", card(source, USE.format(label=label), options))


def _write_press(group: h5py.Group, source: Source, press: Press) -> None:
    rows = source.read([press])
    count = len(press.rows)
    group.attrs["num_samples"], group.attrs["press"] = count, press.name
    for name, variable in source.variables.items():
        if variable.kind == "text":
            values = np.char.encode(rows[name].astype(str), "utf-8")
            # of one length: others take 4 kB for each indentation
            kind = h5py.string_dtype("utf-8", max(values.itemsize, 1))
            group.create_dataset(f"about/{name}", data=values.astype(kind), dtype=kind)
        else:
            image = variable.kind == "image"
            values = np.stack([pixels(content) for content in rows[name]]) if image else rows[name]
            large = values.ndim > 1 and values[0].size > 100
            group.create_dataset(
                f"obs/{name}",
                data=values,
                chunks=(1, *values.shape[1:]) if large else None,
                compression="gzip" if large else None,
                shuffle=large and values.itemsize > 1,
            )
    group["actions"] = np.column_stack([rows["position_mm"], rows["depth_mm"]])
    group["rewards"] = np.zeros(count)
    group["dones"] = np.arange(count) == count - 1


EXPORT = Export(
    "robomimic",
    "`demonstrations.hdf5`: a demonstration per indentation, `mask/train`, `mask/valid`, `mask/test`; any HDF5 reader",
    write,
)
