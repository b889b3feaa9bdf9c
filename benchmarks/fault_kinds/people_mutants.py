"""Files as other programs write them, and what goes wrong there: force and stage logs, test curves, surfaces.

Each kind has a right neighbour (`honest`), which must be read to the same result.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.fault_kinds.table_mutants import Mutant, Table

EPOCH_S = 1.71e9
COUNTS = 10_000_000  # to a newton
FORCES = ("fx_N", "fy_N", "fz_N")


def _stamped(table: Table, write: Callable[[float], str]) -> list[list[str]]:
    """Return the rows with another text of their time."""
    at = table.header.index("time_s")
    return [[*row[:at], write(float(row[at])), *row[at + 1 :]] for row in table.rows]


def sparse(table: Table, rng) -> Mutant:
    """Put rows of another topic between, whose own columns are empty here."""
    nothing = ("", "nan", "NaN", "N/A", "null")[rng.integers(5)]
    rows = []
    for row in table.rows:
        rows += [[*row, nothing]] if rng.integers(3) else [[*row, nothing], _other(table, row, nothing)]
    hole = bool(rng.integers(2))
    if hole:  # one value of one row is missing: no row of another topic
        rows[int(rng.integers(len(rows) // 3))][1] = nothing
    return Mutant(
        table.text([*table.header, "other"], rows),
        f"rows of another topic, {nothing!r}{', one value missing' if hole else ''}",
        honest=not hole,
    )


def _other(table: Table, row: list[str], nothing: str) -> list[str]:
    kept = table.header.index("time_s")
    return [cell if i == kept else nothing for i, cell in enumerate(row)] + ["1"]


def few_digits(table: Table, rng) -> Mutant:
    """Write the stamps as an epoch, with all digits or too few."""
    form = (".12g", ".6g", ".8g", ".9g", "")[rng.integers(5)]
    single = lambda t: f"{np.float32(EPOCH_S + t):.1f}"  # noqa: E731
    rows = _stamped(
        table,
        (lambda t: f"{EPOCH_S + t:.6f}")
        if form == ".12g"
        else single
        if not form
        else lambda t: f"{EPOCH_S + t:{form}}",
    )
    return Mutant(table.text(rows=rows), f"stamps of an epoch as {form or 'float32'}", honest=form == ".12g")


def clock_steps(table: Table, rng) -> Mutant:
    """Set the clock once, forwards or back."""
    times = np.array([float(row[table.header.index("time_s")]) for row in table.rows])
    at, by = (
        float(rng.uniform(*np.quantile(times, [0.3, 0.7]))),
        float(rng.choice([-2.0, -0.3, 0.3, 2.0, 3600])),
    )
    rows = _stamped(table, lambda t: f"{t + by * (t > at):.6f}")
    return Mutant(table.text(rows=rows), f"a clock that steps by {by:g} s at {at:.3g} s")


def counts(table: Table, rng) -> Mutant:
    """Write whole counts below the maker's lines; torque has counts of its own, and may be all that is stated."""
    above = [f"Counts/Nm,{COUNTS // 7}", f"Counts per Unit Torque: {COUNTS // 7}"][rng.integers(2)]
    stated = bool(rng.integers(3))
    force = (f"Counts/N,{COUNTS}", f"Counts per Unit Force: {COUNTS}", f"CpF={COUNTS}")[rng.integers(3)]
    lines = [force, above][:: rng.choice([-1, 1])] if stated else [above]
    at = [table.header.index(name) for name in FORCES]
    rows = [
        [str(round(float(cell) * COUNTS)) if i in at else cell for i, cell in enumerate(row)]
        for row in table.rows
    ]
    text = "\n".join(lines) + "\n" + table.text(rows=rows).decode()
    return Mutant(text.encode(), f"counts below {lines}", honest=stated)


def dates(table: Table, rng) -> Mutant:
    """Write times of day in a column that is declared in seconds."""
    form = (
        lambda t: f"{int(t // 3600)}:{int(t // 60) % 60:02d}:{t % 60:06.3f}",
        lambda t: f"2026-03-14T10:00:{t % 60:06.3f}",
    )
    return Mutant(table.text(rows=_stamped(table, form[rng.integers(2)])), "dates for seconds")


LOGS: dict[str, Callable[[Table, np.random.Generator], Mutant]] = {
    "rows of other topics": sparse,
    "stamps of few digits": few_digits,
    "clock set": clock_steps,
    "counts": counts,
    "dates": dates,
}


def _numbers(text: str) -> float:
    return float(text.replace(",", "."))


def encodings(table: Table, rng) -> Mutant:
    """Write UTF-16 or UTF-32, with a mark or without."""
    name = ("utf-16-le", "utf-16-be", "utf-32-le", "utf-32-be")[rng.integers(4)]
    mark = bool(rng.integers(2))
    text = ("\ufeff" if mark else "") + table.text().decode()
    return Mutant(text.encode(name), f"{name} {'with' if mark else 'without'} a mark", honest=mark)


def typographic(table: Table, rng) -> Mutant:
    """Write minus signs as typesetters do."""
    return Mutant(table.text().decode().replace("-", "\u2212").encode(), "minus signs U+2212", honest=True)


def levels_off(table: Table, rng) -> Mutant:
    """Clip the force, or let it level off by itself at the same value, in a channel of coarse steps."""
    at = table.header.index("Kraft")
    values = np.array([_numbers(row[at]) for row in table.rows])
    top, honest = float(rng.uniform(0.5, 0.8)) * values.max(), bool(rng.integers(2))
    step = top / float(rng.choice([20, 50, 200]))
    force = top * np.tanh(values / top) if honest else np.minimum(values, top)
    force = np.round(force / step) * step
    rows = [[*row[:at], f"{v:.5f}".replace(".", ","), *row[at + 1 :]] for row, v in zip(table.rows, force)]
    how = "levels off" if honest else "is clipped"
    return Mutant(table.text(rows=rows), f"Kraft {how} at {top:.3g} in steps of {step:.2g}", honest, honest)


def breaks(table: Table, rng) -> Mutant:
    """Let the specimen break or slip, or let its rows be in no order."""
    at, n = table.header.index("Kraft"), len(table.rows)
    row, what = int(rng.integers(n // 3, n - 5)), int(rng.integers(3))
    if what == 2:
        return Mutant(table.text(rows=[table.rows[i] for i in rng.permutation(n)]), "rows in no order")
    left = (0.0, 0.6)[what]
    change = lambda text: f"{left * _numbers(text):.5f}".replace(".", ",")  # noqa: E731
    return Mutant(
        table.changed([at], range(row, n), change), f"{('a break', 'a slip')[what]} after {row} rows"
    )


CURVES = {
    "encoding": encodings,
    "minus signs": typographic,
    "plateau or saturation": levels_off,
    "break, slip, no order": breaks,
}


def surface(content: bytes, rng) -> Mutant:
    """Write an OBJ file as another program does, or wrongly."""
    lines = content.decode().splitlines()
    points = [line for line in lines if line.startswith("v ")]
    faces = [[int(word) for word in line.split()[1:]] for line in lines if line.startswith("f ")]
    count, relative, normals = len(points), bool(rng.integers(2)), int(rng.integers(4))
    wrong = ("", "", "too far", "zero", "two corners", "a hole")[rng.integers(6)]
    which = int(rng.integers(len(faces)))
    if wrong == "a hole":
        del faces[which]
    elif wrong:
        faces[which] = {"too far": [*faces[which][:2], count + 1], "zero": [0, *faces[which][1:]]}.get(
            wrong, faces[which][:2]
        )
    ends = ("", "//1", "/1", "/1/1")[normals]
    numbers = [[v - count - 1 if relative and v > 0 else v for v in face] for face in faces]
    body = ["f " + " ".join(f"{v}{ends}" for v in face) for face in numbers]
    head = ["mtllib missing.mtl", "o Ball"][: rng.integers(3)]
    text = "\n".join([*head, *points, "vt 0 0", "vn 0 0 1", "g side", "usemtl steel", "s 1", *body])
    said = f"{'relative' if relative else 'plain'} corners v{ends}{', ' + wrong if wrong else ''}"
    return Mutant(
        (text.replace("\n", ("\n", "\r\n")[rng.integers(2)]) + "\n").encode(), said, honest=not wrong
    )
