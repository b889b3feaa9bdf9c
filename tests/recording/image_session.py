"""Sessions with drawn images in which the surface moves outwards under each indentation, and faults to be put in."""

from pathlib import Path

import cv2
import numpy as np
from drawn import outward, photograph, speckle
from session_folder import HEADER

PLACES = [(7, 6), (14, 6), (10, 11)]
DEPTHS = [0.5, 1.0, 1.5]
PX_PER_MM = 4.0  # largest displacement per mm of depth
SCALE = 10.0  # px/mm of the drawn sensor


def indentations(seed=0):
    """Return place and depth of each indentation, shuffled as a session is."""
    every = [(place, depth) for place in PLACES for depth in DEPTHS]
    return [every[k] for k in np.random.default_rng(seed).permutation(len(every))]


def field_of(place, depth, px_per_mm):
    return outward(px_per_mm * depth, (SCALE * place[0], SCALE * place[1]), 30)


def write_image_session(
    folder,
    pattern=None,
    noise=2.0,
    images=1,
    change=None,
    presses=None,
    gain=None,
    finish=None,
    extra="",
    px_per_mm=PX_PER_MM,
    before=True,
):
    """Write a session and return its folder.

    images: at each depth; before: one before contact too. change(names, pictures): alters the pictures in the order taken.
    gain(k): brightness of the k-th picture. finish: what is done to every picture, the reference frame too.
    """
    folder, pattern = Path(folder), pattern or speckle()
    (folder / "images").mkdir(parents=True)
    lines, names, pictures = [HEADER], [], []
    for order, (place, depth) in enumerate(presses or indentations()):
        shown = [("zero", -1.0, 0.0)] + [("dwell", depth, 1.0 + 0.1 * i) for i in range(images)]
        for i, (phase, at, seconds) in enumerate(shown):
            name = f"p{order:02d}_{i}.png" if at > 0 or before else ""
            field = field_of(place, max(at, 0.0), px_per_mm)
            light = gain(len(pictures)) if gain else 1.0
            if name:
                pictures.append(photograph(pattern, field, 1 + len(pictures), noise, light))
                names.append(name)
            force = (
                1.0 - (depth if at > 0 else 0.0) + 0.003 * np.random.default_rng([order, i]).standard_normal()
            )
            where = f"{phase},{place[0]},{place[1]},{at}"
            lines.append(
                f"p{order:02d},,{order},{10 * order + seconds},{where},1,,0.1,0.1,{force:.4f},{name}"
            )
        lines.append(
            f"p{order:02d},,{order},{10 * order + 5},unload,{place[0]},{place[1]},{depth / 2},1,,0.1,0.1,0.9,"
        )
    (folder / "session.yaml").write_text(f"session: {folder.name}\nforce: {{acts_on: sensor}}\n{extra}")
    (folder / "indentations.csv").write_text("\n".join(lines) + "\n")
    finish = finish or (lambda picture: picture)
    cv2.imwrite(str(folder / "reference.png"), finish(photograph(pattern, seed=0, noise=noise)))
    for name, picture in zip(names, change(names, pictures) if change else pictures):
        cv2.imwrite(str(folder / "images" / name), finish(picture))
    return folder
