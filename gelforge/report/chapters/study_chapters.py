"""Chapters about the study itself: overview, simulated indentations, images, failed sites, time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from gelforge.indentation.cells.cell_file import read_timings
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.recording.optics.remap import picture_of
from gelforge.report.chapters.chapter import Chapter, Facts, count
from gelforge.report.chapters.flow_floor import tell_flow_floor
from gelforge.report.chapters.results_reader import StudyResults, is_papers_sensor
from gelforge.report.figures.measurements.flow_figure import flow_figure, read_picture
from gelforge.report.figures.simulation.force_depth import ForceDepth, deviation_table, force_depth_figure
from gelforge.report.figures.simulation.section import section_figure
from gelforge.report.figures.simulation.sensor_figure import sensor_figure
from gelforge.report.figures.timing import stage_times

FORCE_ONLY = "the sessions have no images with features; forces are compared, but nothing is learnt."
LABELS_ONLY = "this study has no recording sessions: it makes force labels only."


def glance(results: StudyResults) -> Chapter:
    """Return the study at a glance."""
    study, chapter = results.study, Chapter("glance", "The study at a glance")
    sensor = study.sensor
    layers = ", ".join(f"{lay.thickness_mm:g} mm {lay.name} ({lay.material})" for lay in sensor.layers)
    depths = sorted({d for c in results.planned.values() for d in c.depths_mm})
    planned, good = results.planned.values(), results.converged()
    mirrored = sum(cell.source is not None for cell in planned)
    between = sum(bool(cell.between) and cell.source is None for cell in planned)
    cells = count(len(planned), "position") + (
        f", of which {mirrored} mirrored from others" if mirrored else ""
    )
    cells += f" and {between} interpolated between solved sites" if between else ""
    steps = f"{depths[0]:g} to {depths[-1]:g} mm, {count(len(depths), 'depth')}"
    facts = [
        ("Sensor", f"{sensor.width_x_mm:g} x {sensor.width_y_mm:g} x {sensor.height_mm:g} mm"),
        ("Layers from the base up", f"{layers}; wall {sensor.wall_mm:g} mm"),
        ("Indenter", study.indenter.words),
        ("Plan", f"{cells}; {steps}"),
        ("Sites", f"{len(good)} converged, {len(planned) - len(good)} failed or missing"),
        ("Label", f"force on {sensor.bins.nx} x {sensor.bins.ny} surface bins, x, y and z"),
        ("Recordings", _recordings(results)),
        ("Dataset", _dataset(results)),
        ("Data", _data_kind(results)),
    ]
    chapter.add(Facts(facts))
    session = next(iter(results.sessions.values()), None)
    return chapter.show(
        "The sensor from above and cut through the middle: the dots are the positions the ball presses"
        + (", the dashed frame is what the camera sees." if session and session.camera else "."),
        sensor_figure(study, results.planned, session),
    )


def _data_kind(results: StudyResults) -> str:
    if results.synthetic_parts:
        return f"SYNTHETIC {' and '.join(results.synthetic_parts)}, made by a virtual lab"
    return "recorded, as the sessions declare" if results.study.sessions else "simulated labels only"


def _dataset(results: StudyResults) -> str:
    if results.manifest is None:
        return "no manifest.json: the dataset was not made"
    rows = results.manifest["rows"]
    split = f"{rows['train']:,} for training, {rows['test']:,} held out"
    return f"{count(rows['all'], 'row')} ({split}) in {count(len(results.manifest['shards']), 'shard')}"


def _recordings(results: StudyResults) -> str:
    if not results.study.sessions:
        return "none: labels only"
    presses = sum(
        len(np.unique(columns["press"][columns["phase"] != "zero"])) for columns in results.features.values()
    )
    images = sum(len(columns["press"]) for columns in results.features.values())
    if not images:
        presses = len(results.agreement) if results.agreement is not None else 0
    sessions = ", ".join(results.study.sessions)
    text = f"{count(len(results.study.sessions), 'session')} ({sessions}), {count(presses, 'indentation')}"
    return f"{text}, {count(images, 'image')} with features"


def force_depth(results: StudyResults) -> Chapter:
    """Return vertical force over depth at centre and corner; of the article's study next to the article's curves."""
    paper = results.paper_folder
    chapter = Chapter("force-depth", "Force over depth" + (", and the article's" if paper else ""))
    published = results.published_force_depth()
    if paper is None:
        pass
    elif published is None:
        chapter.miss(f"The paper's curves are not drawn: {paper / 'force_depth.csv'} is not there.")
    elif not is_papers_sensor(results.study):
        chapter.miss("The paper's curves are not drawn: this sensor or ball differs from the paper's.")
        published = None
    curves = []
    for place, landmark in (("centre", "centre"), ("corner, 5 mm from two edges", "corner")):
        sites, where = results.sites_at(landmark)
        if not sites:
            chapter.miss(f"No curve at the {place}: the plan has no converged site there.")
            continue
        curves.append(_curve(results, f"{place}{' ' if len(sites) == 1 else chr(10)}{where}", sites))
        if published is not None and len(sites) == 1:
            here = published["location"] == {"centre": "center"}.get(landmark, landmark)
            curves[-1] = replace(curves[-1], published=published[here])
    if not curves:
        return chapter
    words = "Blue is our simulated force"
    words += (
        "; the closer to the dashed grey line, the better it agrees with the published FEM."
        if published is not None
        else "."
    )
    if results.study.mechanics.strain == "small":
        words += (
            " This study uses SMALL-STRAIN linear elasticity, to be compared with the paper's linear curve."
        )
    for name, variant in results.study.variants.items():
        if any(name in curve.variants for curve in curves):
            words += f" Variant {name}: {variant.describes or 'other settings'}."
        else:
            chapter.miss(
                f"No curve of variant {name}: {results.folder / 'variants' / name} has no such site."
            )
    if any(len(c.ft_N) for c in curves) and "recordings" in results.synthetic_parts:
        words += " The study's F/T readings (orange) are SYNTHETIC."
    if results.has_one_depth_each:
        words += " Sites have one depth each, so neighbouring ones are drawn together."
    chapter.show(words, force_depth_figure(curves, results.resolution_N[2]))
    tables = [table for curve in curves if (table := deviation_table(curve)) is not None and len(table)]
    if tables:
        words = "Vertical force and that of the published FEM; nothing was tuned to bring them together."
        chapter.tabulate(words, pd.concat(tables))
    return chapter


def _curve(results: StudyResults, title: str, sites: list[PlannedCell]) -> ForceDepth:
    """Return simulated and read forces over depth of a site, or of several together."""
    cells = [results.cell(site.name).arrays for site in sites]
    depth = np.concatenate([arrays["depth_mm"] for arrays in cells])
    force = np.concatenate([arrays["total_force_N"][:, 2] for arrays in cells])
    order = np.argsort(depth, kind="stable") if len(sites) > 1 else slice(None)
    readings = results.agreement
    here = None if readings is None else readings[readings["cell"].isin([site.name for site in sites])]
    ft = np.zeros((0, 2)) if here is None else here[["depth_mm", "ft_z_N"]].to_numpy(float)
    variants = _variant_curves(results, sites[0].name) if len(sites) == 1 else {}
    return ForceDepth(title, depth[order], force[order], ft[:, 0], ft[:, 1], None, variants, len(sites))


def _variant_curves(results: StudyResults, name: str) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return depths [mm] and Fz [N] of a site by variant, of the variants that have solved it."""
    cells = {variant: results.variant_cell(variant, name) for variant in results.study.variants}
    return {
        variant: (cell.arrays["depth_mm"], cell.arrays["total_force_N"][:, 2])
        for variant, cell in cells.items()
        if cell
    }


def inside(results: StudyResults) -> Chapter:
    """Return the deformed section and the contact pressure of one indentation."""
    chapter = Chapter("inside", "Inside an indentation")
    good = sorted(
        (c for c in results.converged() if c.solved),
        key=lambda c: np.hypot(*(np.array([c.x_mm, c.y_mm]) - results.centre_mm)),
    )
    if not good:
        return chapter.miss("No section: no site converged.")
    cell = results.cell(good[0].name)
    if "section_node_mm" not in cell.arrays:
        return chapter.miss(f"No section: the file of site {good[0].name} holds none.")
    names = [str(name) for name in cell.attributes["regions"]]
    return chapter.show(
        f"Site {good[0].name} at its deepest: left, the layers cut under the ball (dashed: before the indentation);"
        " right, the pressure between ball and skin seen from above, darkest where it is largest.",
        section_figure(cell.arrays, -1, names, (good[0].x_mm, good[0].y_mm), results.study.indenter),
    )


def images(results: StudyResults) -> Chapter:
    """Return one image with its flow, and the flow of all images next to that before contact."""
    chapter = _one_image(results)
    tell_flow_floor(chapter, results)
    return chapter


def _one_image(results: StudyResults) -> Chapter:
    chapter = Chapter("images", "What the camera sees")
    if not results.study.sessions:
        return chapter.miss(f"No images: {LABELS_ONLY}")
    if not results.features:
        return chapter.miss(f"No images: {FORCE_ONLY}")
    for name, columns in results.features.items():
        pressed = np.flatnonzero(columns["phase"] != "zero")
        if not len(pressed) or name not in results.sessions:
            continue
        session = results.sessions[name]
        deepest = pressed[columns["depth_mm"][pressed] >= columns["depth_mm"][pressed].max() - 1e-6]
        distance = np.linalg.norm(columns["position_mm"][deepest] - results.centre_mm, axis=1)
        row = int(deepest[distance.argmin()])
        path = results.study.session_folder(name) / "images" / columns["image"][row]
        if not path.is_file():
            chapter.miss(f"The image {path} is not there.")
            continue
        x, y = columns["position_mm"][row]
        label = "SYNTHETIC image" if session.synthetic else "Image"
        return chapter.show(
            f"{label} of session {name}, ball at ({x:g}, {y:g}) mm and {columns['depth_mm'][row]:g} mm deep:"
            " the arrows point away from the ball where particles are pushed outwards.",
            flow_figure(read_picture(path, picture_of(session)), results.feature_row(name, row)),
        )
    return chapter.miss("No image of an indentation was found.")


def failed_cells(results: StudyResults) -> Chapter:
    """Return the sites that failed or are missing, by name and reason."""
    chapter = Chapter("failed", "Failed sites")
    failed = results.not_converged()
    if not failed:
        return chapter.say(f"None: all {len(results.planned)} sites converged.")
    rows = []
    for cell in failed:
        attributes = results.cell_attributes[cell.name]
        rows.append(
            {
                "cell": cell.name,
                "x [mm]": cell.x_mm,
                "y [mm]": cell.y_mm,
                "status": attributes["status"],
                "last good depth [mm]": float(attributes.get("last_good_depth_mm", np.nan)),
                "reason": attributes.get("reason", ""),
            }
        )
    return chapter.tabulate(
        "These sites are left out of the dataset by name; nothing stands in for them.", pd.DataFrame(rows)
    )


def time_per_stage(results: StudyResults) -> Chapter:
    """Return the time of each stage and of a site."""
    chapter = Chapter("time", "Time per stage")
    truth = results.study.data_folder / "virtual_truth" / "cells"
    stages = stage_times(results.folder, set(results.planned), truth)
    if len(stages):
        table = stages.rename(
            columns={
                "total_s": "all jobs [s]",
                "longest_s": "longest job [s]",
                "memory_MB": "largest memory [MB]",
            }
        )
        chapter.tabulate(
            "Wall seconds as Snakemake measured them, the longest stage first; jobs of a stage can run side by side."
            " Memory is of a job's process.",
            table,
        )
    else:
        chapter.miss(f"No benchmark files in {results.folder / 'benchmarks'}; Snakemake writes them.")
    solved = [results.cell_attributes[c.name] for c in results.converged() if c.solved]
    if solved:
        names = [c.name for c in results.converged() if c.solved]
        timings = [read_timings(results.cell_path(name)) for name in names]
        seconds = [float(known["seconds"]) for known in timings if "seconds" in known]
        iterations = [int(np.sum(a["iterations"])) for a in solved]  # stored per depth
        took = f"{np.median(seconds):.1f} s (median; longest {max(seconds):.1f} s) and " if seconds else ""
        chapter.say(
            f"A simulated site took {took}"
            f"{np.median(iterations):.0f} Newton iterations (median), over {count(len(solved), 'site')}."
        )
    return chapter


def origin(results: StudyResults) -> Chapter:
    """Return what is synthetic and what is measured."""
    chapter = Chapter("origin", "What is synthetic, what is measured")
    rows = []
    for name, material in results.study.materials.items():
        kind = (
            "measured tests"
            if material.tests
            else "fitted elsewhere"
            if material.file
            else "given parameters"
        )
        law = results.laws.get(name)
        made = "SYNTHETIC readings" if material.file else "SYNTHETIC tests"
        kind = made if law is not None and law.synthetic else kind
        rows.append((f"material {name}", kind, str(material.source or "configuration")))
    for name in results.study.sessions:
        session = results.sessions.get(name)
        kind = "session.yaml missing"
        if session is not None:
            kind = "SYNTHETIC recording" if session.synthetic else "recorded"
        rows.append((f"session {name}", kind, str(results.study.session_folder(name))))
    rows.append(("force labels", "simulated by finite elements", str(results.folder / "cells")))
    chapter.tabulate(
        "Agreement with SYNTHETIC data shows that the stages work, not that a real sensor behaves so."
        if results.synthetic_parts
        else "What each part of this report rests on.",
        pd.DataFrame(rows, columns=["part", "kind", "where"]),
    )
    versions = sorted(
        {str(a.get("code_version")) for a in results.cell_attributes.values() if "code_version" in a}
    )
    if versions:
        chapter.say(f"Sites were simulated by code version {', '.join(versions)}.")
    return chapter
