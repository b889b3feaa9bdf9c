"""One recording under two names is found, and sessions that only look alike are not."""

import shutil

import cv2
import numpy as np
import pandas as pd
import pytest
from session_folder import write_session

from gelforge.recording.copies import check_copies
from gelforge.recording.tables.checks import RecordingError


def copied(folder, name):
    other = folder.parent / name
    shutil.copytree(folder, other)
    text = (other / "session.yaml").read_text()
    (other / "session.yaml").write_text(text.replace(f"session: {folder.name}", f"session: {name}"))
    return other


def check(*folders):
    check_copies({folder.name: folder for folder in folders})


def edit(folder, change):
    path = folder / "indentations.csv"
    change(pd.read_csv(path)).to_csv(path, index=False)


@pytest.mark.parametrize("images", [False, True])
def test_a_copy_under_another_name_is_refused(tmp_path, images):
    one = write_session(tmp_path / "one", images=images, presses=4)
    other = copied(one, "other")
    with pytest.raises(RecordingError, match=r"sessions one and other.*12 of 12 readings.*count twice"):
        check(one, other)
    # other names of indentations, another zero, and fewer of them
    edit(
        other, lambda t: t.assign(press=t["press"].str.upper(), depth_mm=t["depth_mm"] + 0.01)[t["order"] > 0]
    )
    with pytest.raises(RecordingError, match=r"9 of 9 readings"):
        check(one, other)


def test_sessions_of_one_program_are_no_copies_but_equal_force_logs_are(tmp_path):
    # Sessions of one program are no copies. Positions and times are equal, forces are not; where these are coarse
    # and agree too, the images are not
    one = write_session(tmp_path / "one", images=True, presses=4)
    other = copied(one, "other")
    for path in (other / "images").iterdir():
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        noise = np.random.default_rng(0).integers(0, 3, image.shape)
        cv2.imwrite(str(path), (image // 2 + noise).astype(np.uint8))
    check(one, other)
    forces = copied(one, "forces")
    edit(forces, lambda table: table.assign(fz_N=table["fz_N"] + 0.001))
    check(one, forces)

    # Forces next to the table are compared
    logged = tmp_path / "logged"
    one = write_session(logged / "one")
    edit(one, lambda table: table.drop(columns=["fx_N", "fy_N", "fz_N"]))
    (one / "ft.csv").write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,0\n20,0,0,-1\n")
    other = copied(one, "other")
    with pytest.raises(RecordingError, match="hold the same recording"):
        check(one, other)
    (other / "ft.csv").write_text("time_s,fx_N,fy_N,fz_N\n0,0,0,0\n20,0,0,-1.01\n")
    check(one, other)
