"""A folder of images alone to a session: position, depth and force stand in their names."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pandas as pd

from gelforge.config import Session, section_from, write_yaml
from gelforge.config.foreign.named_images import NamedImages, NamesMapping
from gelforge.importing.refusals import ImportingError
from gelforge.importing.session_files import COLUMNS, FORCE
from gelforge.recording.imaging.frames import images_in
from gelforge.recording.imaging.images import refuse_turned

# Between readings whose time is not known: numbers in order. Only the order counts, as
# tests/importing/test_named_images.py shows.
STEP_S = 10.0


def named_readings(folder: Path, images: NamedImages) -> pd.DataFrame:
    """Return a row per image: press, time_s, x_mm, y_mm, depth_mm, the forces [N] and its path, in the order taken.

    Without a time the order is that of the indentations' first images, and of growing depth within each: images of one
    place are one indentation, those of a depth that is there already the next. With a time an indentation ends where the
    place changes, or where rest follows contact. A force that no name holds is 0.
    Raises ImportingError for a name of another form.
    """
    path = folder / images.folder
    if not path.is_dir():
        raise ImportingError(f"{path}: no such folder; correct images.folder")
    expression, names, factors = images.expression, images.quantities, images.factors
    rows = []
    for file in images_in(path):
        if file.name == images.reference:
            continue
        match = expression.fullmatch(file.name)
        if not match:
            raise ImportingError(
                f"{file}: is not of the form {images.names!r}; correct images.names, or take the file away"
            )
        texts = dict(zip(names, match.groups()))
        row = {name: float(texts[name]) * factor for name, factor in factors.items()}
        rows.append(row | {"press": texts.get("press", ""), "path": file})
    if not rows:
        raise ImportingError(f"{path}: no images in this folder; correct images.folder")
    table = pd.DataFrame(rows)
    if "time" in table:
        table = table.sort_values("time", kind="stable")
    table["press"] = _presses(table, "press" in names)
    if "time" not in table:
        first = table.groupby("press", sort=False).ngroup()
        table = table.assign(first=first).sort_values(["first", "depth"], kind="stable")
        table["time"] = STEP_S * np.arange(len(table))
    table = table.rename(columns={name: f"{name}_mm" for name in ("x", "y", "depth")} | {"time": "time_s"})
    forces = {f"f{a}_N": table[f"f{a}"] if f"f{a}" in table else 0.0 for a in "xyz"}
    return table.assign(**forces).reset_index(drop=True)


def _presses(table: pd.DataFrame, named: bool) -> pd.Series:
    """Return the name of each reading's indentation."""
    if named:
        return table["press"]
    place = table.groupby(["x", "y"], sort=False).ngroup()
    if "time" in table:  # a place that is left, or rest after contact, ends an indentation
        ends = (place != place.shift()) | ((table["depth"] <= 0) & (table["depth"].shift() > 0))
        return "p" + ends.cumsum().map("{:04d}".format)
    again = table.groupby(["x", "y", "depth"]).cumcount()
    number = pd.DataFrame({"place": place, "again": again}).groupby(["again", "place"], sort=False).ngroup()
    return "p" + (number + 1).map("{:04d}".format)


def write_named(folder: Path, mapping: NamesMapping, name: str, data: Path, source: str) -> int:
    """Write the session folder of images whose names state position and force.

    Parameters
    ----------
    folder : Path
        Receives session.yaml, indentations.csv, reference.png and images/.
    mapping : NamesMapping
        What the parts of a name mean, and the keys of the session.
    name : str
        Of the session.
    data : Path
        The folder that holds the images.
    source : str
        The mapping's file, for messages.

    Returns
    -------
    int
        Number of images.

    Raises
    ------
    ImportingError
        For names, images or a reference that cannot be used.
    ConfigError
        For keys of the session that are wrong.
    """
    table = named_readings(data, mapping.images)
    said = dict(mapping.session)
    zero = {"how": "as the names of the images say", **(said.get("depth_zero") or {})}
    notes = "; ".join(
        text for text in (said.get("notes"), f"imported from names: {mapping.describes}") if text
    )
    force = {"tared": True, **said["force"]}
    keys = {**said, "force": force, "depth_zero": zero, "session": name, "notes": notes}
    session = section_from(Session, keys, f"{source}: session")
    reference = _reference(data, mapping.images, table)
    returned = table["depth_mm"] < table.groupby("press")["depth_mm"].cummax()
    table["phase"] = np.where(table["depth_mm"] <= 0, "zero", np.where(returned, "unload", "load"))
    if not (table.groupby("press")["phase"].first() == "zero").all():
        table = _with_zeros(table, session.force.tared)
    table["order"] = table.groupby("press", sort=False).ngroup()
    (folder / "images").mkdir(parents=True)
    for path in table["path"].dropna():
        refuse_turned(path)
        shutil.copyfile(path, folder / "images" / path.name)
    refuse_turned(reference)
    image = cv2.imread(str(reference), cv2.IMREAD_UNCHANGED)
    if image is None or not cv2.imwrite(str(folder / "reference.png"), image):
        raise ImportingError(f"{reference}: cannot be decoded as an image; copy it again")
    table["image"] = [path.name if isinstance(path, Path) else "" for path in table["path"]]
    table.reindex(columns=COLUMNS).to_csv(folder / "indentations.csv", index=False, float_format="%.9g")
    write_yaml(folder / "session.yaml", session)
    return int((table["image"] != "").sum())


def _reference(data: Path, images: NamedImages, table: pd.DataFrame) -> Path:
    if images.reference:
        path = data / images.folder / images.reference
        if not path.is_file():
            raise ImportingError(f"{path}: the image without contact is missing; correct images.reference")
        return path
    untouched = table.loc[table["depth_mm"] <= 0, "path"]
    if untouched.empty:
        raise ImportingError(
            f"{data / images.folder}: no image of depth 0; name the one without contact: images.reference"
        )
    return untouched.iloc[0]


def _with_zeros(table: pd.DataFrame, tared: bool) -> pd.DataFrame:
    """Return readings with a row at rest before each indentation that has none; its force is 0, as the names' zero is."""
    first = table.groupby("press", sort=False).head(1)
    first = first[first["phase"] != "zero"]
    if not tared:
        raise ImportingError(
            f"{first['path'].iloc[0]}: its indentation has no image of depth 0 that shows the force at rest; set"
            " session.force.tared: true if zero is subtracted already"
        )
    before = first.assign(phase="zero", depth_mm=np.nan, path=None, time_s=first["time_s"] - STEP_S / 2)
    before[FORCE] = 0.0
    order = table.groupby("press", sort=False).ngroup()
    both = pd.concat([before.assign(at=order), table.assign(at=order)])
    return both.sort_values(["at", "time_s"], kind="stable").drop(columns="at").reset_index(drop=True)
