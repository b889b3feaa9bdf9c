"""What the constants of the contact iteration change in labels: nothing that their error bars would notice.

python benchmarks/contact_constants.py [--x 12 --y 16]

One site of the article's study, with error bars, at the default constants and with each augmentation times 4 and 16. Per
depth: the largest change of a bin over its own sigma, and over the largest shear; and the CPU seconds of each run.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import pandas as pd

from gelforge.api.studies import paper_study
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.solving.companion import simulate_label
from gelforge.laws_of_study import laws_of

DEPTHS = (0.5, 1.0, 1.5, 2.0)


def label(x: float, y: float, **augmentations: float):
    """Return the cell of a site with other augmentations, and its CPU seconds."""
    study = paper_study()
    mechanics = study.mechanics
    contact = mechanics.contact.model_copy(update=augmentations)
    study = study.model_copy(update={"mechanics": mechanics.model_copy(update={"contact": contact})})
    clock = time.process_time()
    cell = simulate_label(study, laws_of(study, []), {}, PlannedCell("site", x, y, DEPTHS))
    if not cell.converged:
        raise SystemExit(f"the site failed: {cell.attributes['reason']}")
    return cell, time.process_time() - clock


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--x", type=float, default=12.0, help="position [mm]")
    parser.add_argument("--y", type=float, default=16.0, help="position [mm]")
    places = parser.parse_args()
    contact = paper_study().mechanics.contact
    known, seconds = label(places.x, places.y)
    bins, sigma = known.arrays["bin_force_N"], known.arrays["bin_sigma_mesh_N"]
    largest = np.abs(bins[..., :2]).max(axis=(1, 2))
    print(f"default: {seconds:.1f} CPU s")
    rows = []
    for name in ("normal_augmentation", "tangential_augmentation"):
        for factor in (4, 16):
            cell, seconds = label(places.x, places.y, **{name: factor * getattr(contact, name)})
            change = np.abs(cell.arrays["bin_force_N"] - bins)
            shares = np.divide(change, sigma, out=np.zeros_like(change), where=sigma > 0)
            for d, depth in enumerate(known.arrays["depth_mm"]):
                shear = change[d, :, :2].max() / largest[d]
                rows.append([name, factor, depth, shares[d].max(), shear, seconds])
    columns = [
        "constant",
        "times",
        "depth [mm]",
        "change of a bin [sigma]",
        "change [largest shear]",
        "CPU s",
    ]
    print(pd.DataFrame(rows, columns=columns).to_markdown(index=False, floatfmt=".2g"))


if __name__ == "__main__":
    main()
