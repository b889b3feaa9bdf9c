"""Small session folders as a laboratory would write them, for tests of what reads them."""

from pathlib import Path

import cv2
import numpy as np

HEADER = "press,cell,order,time_s,phase,x_mm,y_mm,depth_mm,speed_mm_per_s,dwell_s,fx_N,fy_N,fz_N,image"
OFFSET = (0.5, -0.25, 1.0)  # what the untared force sensor shows at zero


def press_lines(name, order, x, y, depth, images):
    """Return the lines of one press: two zero readings, arrival, two images, one reading in unloading."""
    ox, oy, oz = OFFSET
    start = 10 * order
    image = (lambda i: f"{name}_{i}.png") if images else (lambda i: "")
    zero = f"{name},,{order},{{}},zero,{x},{y},-1,1,,{ox},{oy},{oz},{{}}"
    held = f"{name},,{order},{{}},{{}},{x},{y},{depth},1,{{}},{ox + 0.1},{oy - 0.2},{oz - depth},{{}}"
    return [
        zero.format(start, image(0)),
        zero.format(start + 0.1, ""),
        held.format(start + 2, "load", 0, ""),
        held.format(start + 3, "dwell", 1, image(1)),
        held.format(start + 4, "dwell", 2, image(2)),
        f"{name},,{order},{start + 5},unload,{x},{y},{depth / 2},1,,{ox},{oy},{oz - 0.1},",
    ]


def write_session(folder, images=False, presses=2, extra="", lines=None):
    """Return a session folder with presses a, b, ... at depths 0.5 and 1 mm, in the sensor's frame, not tared."""
    folder = Path(folder)
    (folder / "images").mkdir(parents=True)
    (folder / "session.yaml").write_text(f"session: {folder.name}\nforce: {{acts_on: sensor}}\n{extra}")
    names = ["a", "b"] if presses == 2 else [f"p{i:03d}" for i in range(presses)]
    rows = [
        line
        for order, name in enumerate(names)
        for line in press_lines(name, order, 10 + order % 2, 12, 0.5 * (1 + order % 2), images)
    ]
    (folder / "indentations.csv").write_text("\n".join(lines or [HEADER, *rows]) + "\n")
    if images:
        write_images(folder, names)
    return folder


def write_images(folder, names):
    """Write a reference frame of 120 x 140 px with random spots, and images that shift them, further where deeper."""
    rng = np.random.default_rng(0)
    spots = cv2.GaussianBlur(rng.integers(0, 255, (120, 140)).astype(np.uint8), (0, 0), 1.5)
    cv2.imwrite(str(folder / "reference.png"), spots)
    for order, name in enumerate(names):
        for i in range(3):
            deeper = 1 + 0.6 * (order % 2)
            shift = np.float32([[1, 0, 0.5 * i * deeper], [0, 1, -0.3 * i * deeper]])
            moved = cv2.warpAffine(spots, shift, (140, 120), borderMode=cv2.BORDER_REFLECT)
            cv2.imwrite(str(folder / "images" / f"{name}_{i}.png"), moved)
