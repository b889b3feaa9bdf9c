"""One page of an import: signals with the phases marked, the clocks, the contact point of every indentation, and frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from gelforge.importing.camera import grey_image
from gelforge.importing.importer import Aligned, Imported
from gelforge.report.figures.style import (
    FAINT,
    INK,
    MEASURED,
    MOST_PANELS,
    MOST_POINTS,
    PREDICTED,
    PUBLISHED_LINEAR,
    SIMULATED,
    styled,
)

PHASES = {"zero": "#9CC9E5", "load": "#F3C59B", "dwell": "#B8D8B0", "shear": "#D9A7D0", "unload": "#DDDDDD"}


@styled
def import_figure(imported: Imported, folder: Path) -> Figure:
    """Return the page of a session that is written.

    Parameters
    ----------
    imported : Imported
        As `import_logs` returns it.
    folder : Path
        Of the session, with its images.

    Returns
    -------
    Figure
        Signals over time, clocks, contact points and frames.
    """
    kept = imported.presses.kept
    contacts = [kept[i] for i in np.unique(np.linspace(0, len(kept) - 1, 4 * MOST_PANELS).astype(int))]
    columns = 8 if len(contacts) > 6 else max(len(contacts), 4)
    contact_rows = -(-len(contacts) // columns)
    heights = [2.6, 3.4, 2.4, 1.5 * contact_rows] + ([2.0] if imported.frames else [])
    figure = Figure(figsize=(15, sum(heights) + 1.0), layout="constrained", facecolor="white")
    figure.suptitle(title(imported), x=0.01, ha="left", fontsize=11)
    parts = figure.subfigures(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    signals = 3 if imported.frames else 2
    span = (0.0, float(imported.stage.time_s[-1]))
    _signals(imported, parts[0].subplots(signals, 1, sharex=True), span, "All indentations (number above)")
    close = parts[1].subplots(signals, 1, sharex=True)
    _signals(imported, close, _close_span(imported), "The first indentations, close")
    _clocks(imported, parts[2])
    _contacts(imported, contacts, parts[3].subplots(contact_rows, columns, squeeze=False))
    if imported.frames:
        _frames(imported, folder / "images", parts[4])
    return figure


def title(imported: Imported) -> str:
    """Return the page's title: the session and what was found."""
    kept, left = imported.presses.kept, imported.presses.left_out
    text = f"Session {imported.session.session}: {len(kept)} indentations from {imported.mapping.describes}"
    return text + (f"; left out: {', '.join(str(number) for number, _, _ in left)}" if left else "")


def _close_span(imported: Imported) -> tuple[float, float]:
    kept = imported.presses.kept
    return kept[0].zero_s[0] - 0.3, kept[min(3, len(kept)) - 1].end_s + 0.5


def _signals(imported: Imported, axes, span, name: str) -> None:
    """Draw depth, force and image change over time; phases are shaded, readings are marked."""
    axes[0].set_title(name, loc="left")
    depth = imported.stage.values[:, 2] - np.median(imported.zero_mm)
    force = imported.presses.smooth_N
    drawn = [(imported.stage.time_s, depth, SIMULATED, "depth [mm]")]
    drawn.append((imported.force_s, force, MEASURED, "force [N]"))
    if imported.frames and imported.film:
        drawn.append((imported.frames.time_s, imported.film.change, PUBLISHED_LINEAR, "image\nchange [-]"))
    for ax, (time, value, colour, label) in zip(axes, drawn):
        rows = slice(*np.searchsorted(time, span))
        few = max(1, (rows.stop - rows.start) // MOST_POINTS)
        ax.plot(time[rows][::few], value[rows][::few], color=colour, lw=1)
        ax.axhline(0, color=FAINT, lw=0.6)
        ax.set_ylabel(label)
        ax.set_xlim(*span)
        _phases(imported, ax, span)
    low = -1.2 * depth.max()
    axes[0].set_ylim(low, 1.3 * depth.max())
    held = imported.table[imported.table["phase"] != "zero"]
    axes[0].plot(held["time_s"], held["depth_mm"], ".", color=INK, ms=3)
    for press in imported.presses.kept:
        if span[0] <= press.top_s <= span[1]:
            axes[0].annotate(str(press.number), (press.top_s, 1.12 * depth.max()), ha="center", fontsize=8)
            axes[1].axvline(press.touch_s, color=PREDICTED, lw=0.7)
    for number, at, _ in imported.presses.left_out:
        if span[0] <= at <= span[1]:
            text = {"ha": "center", "fontsize": 8, "color": PREDICTED}
            axes[0].annotate(f"({number})", (at, 1.12 * depth.max()), **text)
    axes[-1].set_xlabel("time of the stage [s]")


def _phases(imported: Imported, ax, span) -> None:
    for press in imported.presses.kept:
        if press.end_s < span[0] or press.zero_s[0] > span[1]:
            continue
        ends = [press.touch_s]
        spans = [(press.zero_s, "zero")]
        rows = imported.table[imported.table["press"] == f"p{press.number:03d}"]
        for wait in press.waits:
            if not np.isfinite(wait.arrive_s):
                continue
            phase = rows["phase"].iloc[(rows["time_s"] - wait.arrive_s).abs().argmin()]
            spans.append(((ends[-1], wait.arrive_s), "load" if phase in ("load", "dwell") else phase))
            spans.append(((wait.arrive_s, wait.leave_s), "dwell" if phase in ("load", "dwell") else phase))
            ends.append(wait.leave_s)
        if not press.waits:
            spans.append(((press.touch_s, press.top_s), "load"))
            ends.append(press.top_s)
        spans.append(((ends[-1], press.end_s), "unload"))
        for (start, end), phase in spans:
            if np.isfinite(start + end):
                ax.axvspan(start, end, color=PHASES[phase], alpha=0.6, lw=0)


def _clocks(imported: Imported, part) -> None:
    """Draw correlation over lag, and the lag of each stop and start with the law, for force and camera."""
    clocks = [("force", imported.force_clock)]
    if imported.camera_clock:
        clocks.append(("camera", imported.camera_clock))
    axes = part.subplots(1, 2 * len(clocks) + 1, width_ratios=[*[2, 3] * len(clocks), 2])
    for (name, clock), left, right in zip(clocks, axes[::2], axes[1::2]):
        _correlation(name, clock, left)
        _lags(name, clock, imported, right)
    colours = [*PHASES.items()]
    for k, (phase, colour) in enumerate(colours):
        axes[-1].barh(-k, 1, color=colour)
        axes[-1].annotate(phase, (1.1, -k), va="center")
    last = -len(colours)
    axes[-1].plot([0, 1], [last] * 2, color=PREDICTED, lw=1.2)
    axes[-1].annotate("contact; line of a clock", (1.1, last), va="center")
    axes[-1].plot([0.5], [last - 1], ".", color=INK, ms=4)
    axes[-1].annotate("lag of a stop or start", (1.1, last - 1), va="center")
    axes[-1].set(xlim=(0, 5), title="What is drawn")
    axes[-1].axis("off")


def _correlation(name: str, clock: Aligned, ax) -> None:
    match = clock.match
    rows = slice(None, None, max(1, len(match.lags_s) // MOST_POINTS))
    ax.plot(clock.start_s + match.lags_s[rows], match.correlations[rows], color=INK, lw=0.8)
    ax.plot([clock.start_s + match.lag_s], [match.correlation], "o", color=PREDICTED, ms=4)
    if match.rival:
        ax.plot([clock.start_s + match.rival[0]], [match.rival[1]], "o", mfc="none", mec=PREDICTED, ms=5)
    ax.set(xlabel=f"lag of the {name} clock [s]", ylabel="correlation [-]")
    ax.set_title(f"{name}: correlation with depth")
    ax.margins(y=0.1)


def _lags(name: str, clock: Aligned, imported: Imported, ax) -> None:
    at, law = np.array([0.0, imported.stage.time_s[-1]]), clock.law
    line = law.lag_s + law.rate * at
    middle = float(line.mean())
    ax.plot(clock.bends.at_s, 1e3 * (clock.bends.lag_s - middle), ".", color=INK, ms=4)
    ax.plot(at, 1e3 * (line - middle), color=PREDICTED, lw=1.2)
    error = f" ± {2e3 * law.se_s:.1f} ms" if law.se_s else " (given)"
    ax.set(xlabel="time of the stage [s]", ylabel="lag [ms]")
    ax.set_title(f"{name}: {clock.start_s + middle:.4f} s{error}")
    ax.set_ylim(min(-10, *ax.get_ylim()), max(10, *ax.get_ylim()))


def _contacts(imported: Imported, presses, axes) -> None:
    """Draw force over depth about the contact point of each indentation, with its interval and the law that was fitted."""
    zero = dict(zip((press.number for press in imported.presses.kept), imported.zero_mm))
    travel = np.interp(imported.force_s, imported.stage.time_s, imported.stage.values[:, 2])
    for ax, press in zip(axes.flat, presses):
        contact, at = press.contact, zero[press.number]
        reach = max(0.35 * (press.top_mm[2] - contact.travel_mm), 0.1)
        rows = slice(*np.searchsorted(imported.force_s, [press.zero_s[1], press.top_s]))
        near = np.abs(travel[rows] - contact.travel_mm) < reach
        s, f = travel[rows][near], imported.push_N[rows][near] - contact.rest_N
        few = max(1, len(s) // 400)
        ax.plot(s[::few] - at, f[::few], ".", color=MEASURED, ms=2)
        line = np.linspace(contact.travel_mm - reach, contact.travel_mm + reach, 100)
        fitted = contact.scale * np.maximum(line - contact.travel_mm, 0) ** contact.exponent
        ax.plot(line - at, fitted, color=INK, lw=0.9)
        ax.axvspan(contact.low_mm - at, contact.high_mm - at, color=PREDICTED, alpha=0.25, lw=0)
        ax.axvline(0, color=SIMULATED, lw=0.7, ls=":")
        half = (contact.high_mm - contact.low_mm) / 2
        ax.set_title(f"{press.number}: {contact.travel_mm - at:+.3f} ± {half:.3f}", fontsize=8)
        ax.tick_params(labelsize=7)
    for ax in axes.flat[len(presses) :]:
        ax.axis("off")
    for ax in axes[:, 0]:
        ax.set_ylabel("force [N]", fontsize=8)
    axes[-1, 0].set_xlabel("depth [mm]; band: contact point", fontsize=8)


def _frames(imported: Imported, images: Path, part) -> None:
    """Draw the reference, and of some indentations the last frame of the wait and what changed against their zero frame."""
    kept = imported.presses.kept
    chosen = [kept[i] for i in np.unique(np.linspace(0, len(kept) - 1, MOST_PANELS).astype(int))]
    names = imported.table[imported.table["image"] != ""].groupby("press")["image"]
    pairs = [(press, names.get_group(f"p{press.number:03d}").iloc[[0, -1]]) for press in chosen]
    axes = part.subplots(1, 2 * len(pairs))
    for (press, (zero, held)), left, right in zip(pairs, axes[::2], axes[1::2]):
        before, after = (grey_image(images / name) for name in (zero, held))
        left.imshow(after, cmap="gray", vmin=0, vmax=np.iinfo(after.dtype).max)
        right.imshow(np.abs(after.astype(float) - before), cmap="PuBu")
        left.set_title(f"{press.number}: in the wait", fontsize=8)
        right.set_title("less its zero frame", fontsize=8)
    for ax in axes:
        ax.set(xticks=[], yticks=[])
