"""The chapter about materials: laws and their fits, what else the tests say, and where sites leave the tested range."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.files import read_product_table
from gelforge.indentation.solving.stretch_range import LEAVES
from gelforge.materials.fitting.law_file import MaterialLaw
from gelforge.mechanics.laws.homogeneous import LOAD_CASES
from gelforge.report.chapters.beside_paper import beside_paper, said_beside
from gelforge.report.chapters.chapter import Chapter, count
from gelforge.report.chapters.results_reader import StudyResults
from gelforge.report.figures.measurements.material_figure import material_figure

FROM, SHARE = "from depth [mm]", "share of volume"


def materials(results: StudyResults) -> Chapter:
    """Return the material laws with their fits, the measured effects, and the sites beyond the tested range."""
    chapter = Chapter("materials", "Materials")
    for name in results.study.materials:
        folder = results.folder / "materials" / name
        if name not in results.laws or not (folder / "curves.csv").is_file():
            chapter.miss(f"No constitutive model of {name}: {folder} lacks law.json or curves.csv.")
            continue
        _material(chapter, name, results.laws[name], folder)
    table = results.table("material")
    if table is None:
        chapter.miss(f"No table of parameters: {results.folder / 'tables' / 'material.csv'} is not there.")
    else:
        chapter.tabulate(
            said_beside("Parameters with 95 % intervals{with the paper's}", results.paper)
            + "; the single constants of a constitutive model differ more between"
            " equally good fits than Young's modulus E does.",
            beside_paper("material", table, results.paper),
        )
    _beyond_tests(chapter, results)
    _unstable(chapter, results)
    return chapter


def _material(chapter: Chapter, name: str, law: MaterialLaw, folder: Path) -> None:
    others = sorted((folder / "laws").glob("*.json"))
    if law.samples:
        kind = " These tests are SYNTHETIC." if law.synthetic else ""
        words = f"{name}: the constitutive model's line should run through the mean of the specimens in every test.{kind}"
    else:
        words = f"{name}: the constitutive model's parameters were given in the configuration; no test was fitted."
    chapter.show(words, material_figure(folder / "law.json", folder / "curves.csv", others))
    fold = chapter.fold(f"What else the tests of {name} say: range, other constitutive models, caveats")
    if law.samples:
        fold.say(_range_words(name, law))
        (fold if law.unstable_from is None else chapter).say(_stability_words(name, law))
    compared = _table(folder / "laws.csv")
    if compared is not None and len(compared) > 1:
        fold.tabulate(
            f"{name}: constitutive models compared. AICc: the lowest describes the tests best for its number of"
            " parameters. Error held out: each test predicted from the others.",
            compared,
        )
    for note in law.notes:
        fold.say(f"{name}: {note}.")
    effects = _table(folder / "effects.csv")
    if effects is None:
        chapter.miss(f"{name}: no measured effects, {folder / 'effects.csv'} is not there.")
        return
    judged, rest = effects[effects.verdict != "not judged"], effects[effects.verdict == "not judged"]
    if len(judged):
        # the sentence holds value and interval; columns of their own would squeeze it to a word a line
        shown = judged[["effect", "test", "verdict", "sentence"]].copy()
        shown[["effect", "test"]] = shown[["effect", "test"]].replace("_", " ", regex=True)
        fold.tabulate(
            f"{name}: what its tests say beyond the constitutive model (numbers apart: effects.csv).", shown
        )
    if len(rest):
        reasons = "; ".join(f"{row.effect.replace('_', ' ')}: {row.sentence}" for row in rest.itertuples())
        fold.say(f"{name}: effects that these tests cannot show, and that may be there. {reasons}.")


def _range_words(name: str, law: MaterialLaw) -> str:
    tested = ", ".join(
        f"{low:.4g} to {high:.4g} in {test}" for test, (low, high) in (law.valid_stretch or {}).items()
    )
    text = f"{name}: tested at stretches {tested}"
    valid = law.valid_range
    if valid is not None:
        largest = ", ".join(f"{valid.largest(case):.4g} ({case.replace('_', ' ')})" for case in LOAD_CASES)
        text += f"; the constitutive model's range ends at stretch {largest}"
    return f"{text}."


def _stability_words(name: str, law: MaterialLaw) -> str:
    unstable = law.unstable_from
    stable = "Drucker-stable in all of" if unstable is None else f"NOT Drucker-stable from {unstable:.0%} of"
    return f"The constitutive model of {name} is {stable} the tested range."


def _beyond_tests(chapter: Chapter, results: StudyResults) -> None:
    """List the sites whose elements leave the range in which a law was tested."""
    rows, unknown, judged = [], 0, 0
    for cell in results.converged():
        attributes = results.cell_attributes[cell.name]
        leaves = np.asarray(attributes.get("leaves_valid_range", []))
        unknown += int((leaves < 0).any() or not len(leaves))
        judged += 1
        if (leaves == LEAVES).any():
            rows.append(_beyond(cell, attributes, int(np.argmax(leaves == LEAVES))))
    if rows:
        shallowest, share = (pick(row[key] for row in rows) for pick, key in ((min, FROM), (max, SHARE)))
        chapter.say(
            f"{count(len(rows), 'site')} of {judged} leave the range in which a constitutive model was tested, from"
            f" {shallowest:g} mm on and in {100 * share:.2g} % of a region's volume at most: there it extrapolates."
        )
        chapter.fold("Sites beyond the tested range").tabulate(
            "Stretch and share of the region's volume are those of the deepest step.", pd.DataFrame(rows)
        )
    elif judged and not unknown:
        chapter.say(
            f"All {judged} converged sites stay within the stretches at which their constitutive models were tested."
        )
    if unknown:
        chapter.say(
            f"Of {count(unknown, 'site')} it is not known whether a constitutive model leaves its tested range: its"
            " parameters were"
            " given, or the file is older than this check."
        )


def _unstable(chapter: Chapter, results: StudyResults) -> None:
    """List the sites in which a law is unstable at the stretches that were reached; files without the check are silent."""
    rows = []
    for cell in results.converged():
        attributes = results.cell_attributes[cell.name]
        unstable = np.asarray(attributes.get("law_unstable", []))
        if unstable.any():
            share = np.asarray(attributes["volume_law_unstable"])[-1]
            worst = int(np.argmax(share))
            rows.append(
                {
                    "cell": cell.name,
                    FROM: cell.depths_mm[int(np.argmax(unstable))],
                    "region": str(np.asarray(attributes["regions"])[worst]),
                    SHARE: float(share[worst]),
                }
            )
    if rows:
        chapter.tabulate(
            f"{count(len(rows), 'site')} reach stretches at which a constitutive model is not Drucker-stable: such"
            " labels are not to be"
            " trusted; press less deep or fit another constitutive model. The share of the region's volume is that"
            " of the deepest step.",
            pd.DataFrame(rows),
        )


def _beyond(cell, attributes: dict, first: int) -> dict:
    share = np.asarray(attributes["volume_outside_valid_range"])[-1]
    worst = int(np.nanargmax(share))
    low, high = np.asarray(attributes["stretch_range"])[-1, worst]
    return {
        "cell": cell.name,
        FROM: cell.depths_mm[first],
        "region": str(np.asarray(attributes["regions"])[worst]),
        "smallest stretch": float(low),
        "largest stretch": float(high),
        SHARE: float(share[worst]),
    }


def _table(path: Path) -> pd.DataFrame | None:
    remedy = f"run the material stage again (snakemake -R {path})"
    return read_product_table(path, remedy) if path.is_file() else None
