"""The plan of a study: its sites, each one position with all its depths."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from gelforge.config import ConfigError, Sensor, Study, given, variant_study
from gelforge.indentation.effects.kinematics import touches_a_slope
from gelforge.indentation.paths.places import POSITION_MATCH_MM, gaps_to, within
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.lattice import (
    check_interpolation,
    interpolable,
    lattice_digest,
    lattice_of,
)
from gelforge.indentation.planning.plan_checks import (
    check_count,
    check_mesh,
    check_places,
    check_steps,
    check_unit,
)
from gelforge.indentation.planning.plan_table import cells_from_file
from gelforge.indentation.planning.reach import check_reach, planned_reach
from gelforge.indentation.planning.recorded_plan import cells_from_sessions
from gelforge.indentation.planning.tolerance import place_tolerance_mm
from gelforge.indentation.planning.touching import check_over_sensor, check_reaches
from gelforge.indentation.sensor.indenter_shapes import check_press, check_widest, real_indenter, shape_of
from gelforge.indentation.sensor.sizes import check_indenter, check_sensor_size
from gelforge.indentation.sensor.symmetry import D4, transform_points

# Of an indentation by hand: a third of an element of 0.3 mm, in which friction is followed, and as far for 1 deg at 6 mm
# from the axis (tests/indentation/test_indenters_and_paths.py).
SHEAR_STEP_MM, TWIST_STEP_DEG = 0.1, 1.0


def plan_cells(study: Study) -> dict[str, PlannedCell]:
    """Return the study's sites by name, in the order of the plan, with mirrored sites naming their source.

    Parameters
    ----------
    study : Study
        Its plan: a grid, a file, or the positions of its sessions.

    Returns
    -------
    dict of PlannedCell
        Positions and depths [mm]. With `plan.interpolation` the sites whose label is interpolated are marked.

    Raises
    ------
    ConfigError
        Two sites at one place, a position or depth that cannot be pressed, or a symmetry that does not hold.
    """
    tolerance = place_tolerance_mm(study)
    cells = {name: replace(cell, within_mm=tolerance) for name, cell in _described(study, tolerance).items()}
    check_places(cells, min(POSITION_MATCH_MM, tolerance))
    check_inside(cells, study)
    if study.mirrors_cells:
        cells = _with_sources(cells, study.sensor)
        if study.plan.symmetry == "d4":
            _check_mirrored(cells, study.sensor)
    return cells if study.plan.interpolation is None else _between_sites(cells, study)


def _described(study: Study, tolerance_mm: float) -> dict[str, PlannedCell]:
    """Return the sites as the plan's grid, its file or the sessions have them."""
    plan = study.plan
    if plan.from_ == "sessions":
        return cells_from_sessions(study, tolerance_mm)
    cells = cells_from_file(plan.file, plan.mm_per_unit or 1.0) if plan.file else _from_grid(study)
    check_unit(cells, study)
    return cells


def _between_sites(cells: dict[str, PlannedCell], study: Study) -> dict[str, PlannedCell]:
    """Return the sites with those marked whose label is interpolated between solved sites."""
    check_interpolation(study)
    lattice = lattice_of(study, cells)
    if lattice is None:
        return cells
    decides = lattice_digest(study, lattice)
    inside = {
        name: replace(cell, between=decides) for name, cell in cells.items() if interpolable(study, cell)
    }
    return cells | inside


CORNER_MM = 5.0  # the "corner" of Sferrazza et al. 2019: this far from two edges


def landmarks(cells: dict[str, PlannedCell], study: Study) -> dict[str, PlannedCell]:
    """Return the sites at "centre" and "corner" (5 mm from two edges, that of large x and y first) that exist.

    Parameters
    ----------
    cells : dict of str to PlannedCell
        Sites of the plan.
    study : Study
        Its sensor's widths.

    Returns
    -------
    dict of str to PlannedCell
        At most two, by "centre" and "corner".
    """
    wx, wy = study.sensor.width_x_mm, study.sensor.width_y_mm
    corners = [(x, y) for x in (wx - CORNER_MM, CORNER_MM) for y in (wy - CORNER_MM, CORNER_MM)]
    sites = {}
    for name, places in (("centre", [(wx / 2, wy / 2)]), ("corner", corners)):
        there = (
            cell
            for x, y in places
            for cell in cells.values()
            if within(gaps_to((cell.x_mm, cell.y_mm), (x, y))[0], cell.within_mm)
        )
        if cell := next(there, None):
            sites[name] = cell
    return sites


def variant_cells(cells: dict[str, PlannedCell], study: Study, variant: str) -> dict[str, PlannedCell]:
    """Return the sites of a variant, each to be solved itself: a variant need not have the plan's symmetry.

    Parameters
    ----------
    cells : dict of str to PlannedCell
        Sites of the plan.
    study : Study
        Its `variants`.
    variant : str
        Name of one of them.

    Returns
    -------
    dict of str to PlannedCell
        Those that the variant names; without names the landmarks.

    Raises
    ------
    ConfigError
        For a site that is not in the plan, a plan without landmarks, or a site that the variant cannot press.
    """
    names = study.variants[variant].cells or [cell.name for cell in landmarks(cells, study).values()]
    unknown = [name for name in names if name not in cells]
    if unknown:
        raise ConfigError(f"variants.{variant}.cells: {unknown} are not in the plan; name sites of the plan")
    if not names:
        raise ConfigError(
            f"variants.{variant}: the plan has no site at the centre or {CORNER_MM:g} mm from two edges; name `cells`"
        )
    chosen = {name: replace(cells[name], source=None, symmetry=None, between="") for name in names}
    check_inside(chosen, variant_study(study, variant))
    return chosen


def _axis(width: float, spacing: float, margin: float) -> np.ndarray:
    span = width - 2 * margin
    if span < 0:
        raise ConfigError(
            f"plan.grid.margin_mm {margin} exceeds half the sensor's width {width} mm; make it smaller"
        )
    count = int(np.floor(span / spacing + 1e-9)) + 1
    check_count(count)
    return width / 2 + spacing * (np.arange(count) - (count - 1) / 2)


def _from_grid(study: Study) -> dict[str, PlannedCell]:
    grid, sensor = given(study.plan.grid, "plan.grid"), study.sensor
    xs = _axis(sensor.width_x_mm, grid.spacing_mm, grid.margin_mm)
    ys = _axis(sensor.width_y_mm, grid.spacing_mm, grid.margin_mm)
    check_count(len(xs) * len(ys))
    digits = len(str(max(len(xs), len(ys)) - 1))
    depths = tuple(given(study.plan.depths_mm, "plan.depths_mm"))
    cells = {}
    for iy, y in enumerate(ys):
        for ix, x in enumerate(xs):
            name = f"x{ix:0{digits}d}_y{iy:0{digits}d}"
            cells[name] = PlannedCell(name, round(float(x), 6), round(float(y), 6), depths)
    return cells


def press_path(
    name: str,
    x: float,
    y: float,
    depths: list[float],
    shear: list[float] | None,
    unload: bool,
    twist: float = 0.0,
) -> PlannedCell:
    """Return a site that is pressed by increasing depths, then, if asked, moved sideways, twisted and unloaded.

    Parameters
    ----------
    name : str
        Of the site.
    x, y : float
        Position [mm].
    depths : list of float
        Increasing depths [mm].
    shear : list of 2 floats, optional
        Then move sideways by this [mm], in steps of SHEAR_STEP_MM at most.
    unload : bool
        Then come back by the same depths.
    twist : float
        Before unloading turn about z, through the indenter's centre [deg], in steps of TWIST_STEP_DEG at most.

    Returns
    -------
    PlannedCell
        Path with its phases; without shear, twist and unloading depths alone.
    """
    if shear is None and not twist and not unload:
        return PlannedCell(name, x, y, tuple(depths))
    move = (0.0, 0.0) if shear is None else (float(shear[0]), float(shear[1]))
    steps = [("load", depth, (0.0, 0.0), 0.0) for depth in depths]
    if shear is not None:
        shares = _shares(math.hypot(*move), SHEAR_STEP_MM)
        steps += [("shear", depths[-1], (move[0] * part, move[1] * part), 0.0) for part in shares]
    if twist:
        steps += [("twist", depths[-1], move, twist * part) for part in _shares(abs(twist), TWIST_STEP_DEG)]
    if unload:
        steps += [("unload", depth, move, twist) for depth in [*reversed(depths[:-1]), 0.0]]
    phases, path, shears, twists = zip(*steps)
    moved, turned = shears if any(move) else (), twists if twist else ()
    return PlannedCell(name, x, y, path, phases=phases, shears_mm=moved, twists_deg=turned)


def _shares(length: float, step: float) -> list[float]:
    """Return the shares, increasing to 1, at which a move of this length stops to be in steps of at most `step`."""
    parts = max(1, math.ceil(length / step - 1e-9))
    return [k / parts for k in range(1, parts + 1)]


def check_inside(cells: dict[str, PlannedCell], study: Study) -> None:
    """Refuse a plan that the sensor, its mesh or the indenter do not allow.

    Parameters
    ----------
    cells : dict of str to PlannedCell
        Sites of the plan.
    study : Study
        Sensor, indenter, mesh and effects.

    Raises
    ------
    ConfigError
        For the first site outside the sensor, too deep, or between nodes; names site, value, limit and remedy.
    """
    sensor, effects = study.sensor, study.mechanics.effects
    check_sensor_size(sensor)
    check_mesh(study)
    check_steps(cells, study)
    check_indenter(study)
    described = shape_of(study.indenter)
    real = real_indenter(described, effects)
    same_everywhere = not touches_a_slope(effects)  # then most sites of a plan press equally deep
    checked = set()
    check_over_sensor(study, cells)
    for cell in cells.values():
        where = f"site {cell.name}"
        for shear in cell.shears_mm or ((0.0, 0.0),):
            x, y = cell.x_mm + shear[0], cell.y_mm + shear[1]
            if not (0 <= x <= sensor.width_x_mm and 0 <= y <= sensor.width_y_mm):
                raise ConfigError(
                    f"{where}: position ({x:g}, {y:g}) mm lies outside the sensor "
                    f"({sensor.width_x_mm} x {sensor.width_y_mm} mm); correct the plan"
                )
        kind = cell.deepest_mm if same_everywhere and not cell.follows_a_path else cell.name
        if kind not in checked:
            reach = planned_reach(sensor, effects, real, Trajectory.of(cell, study.plan.approach))
            check_reach(reach, cell.deepest_mm, where)
            check_widest(real, study.indenter.words, reach.depth_mm, where)
            check_press(study, described, cell.deepest_mm, where)
            checked.add(kind)
    check_reaches(study, real, cells)


def _check_mirrored(related: dict[str, PlannedCell], sensor: Sensor) -> None:
    """Refuse symmetry that was asked for and does not hold, or saves nothing."""
    if sensor.width_x_mm != sensor.width_y_mm or sensor.bins.nx != sensor.bins.ny:
        raise ConfigError(
            f"plan.symmetry: d4 needs a square sensor and square bins; found {sensor.width_x_mm} x {sensor.width_y_mm} mm, "
            f"{sensor.bins.nx} x {sensor.bins.ny} bins; use symmetry: auto"
        )
    if len(related) > 1 and all(cell.source is None for cell in related.values()):
        raise ConfigError(
            "plan.symmetry: d4, but no two positions of the plan are mirror images; use symmetry: auto"
        )


def _with_sources(cells: dict[str, PlannedCell], sensor: Sensor) -> dict[str, PlannedCell]:
    """Return the sites of a square sensor, each with the first of the plan that it is an image of, if there is one."""
    names = list(cells)
    positions = np.array([(cell.x_mm, cell.y_mm) for cell in cells.values()]).reshape(-1, 2)
    images = np.stack([transform_points(s, positions, sensor.width_x_mm) for s in D4])  # (8, sites, 2)
    places = [list(map(tuple, row)) for row in np.round(images, 6).swapaxes(0, 1).tolist()]
    solved: dict[tuple, int] = {}  # number of the site solved at a place, to some depths
    related = {}
    for number, cell in enumerate(cells.values()):
        if cell.follows_a_path:  # solved itself: its moves have directions of their own
            related[cell.name] = cell
            continue
        keys = [(place, cell.depths_mm) for place in places[number]]
        source = next((solved[key] for key in keys if key in solved), None)
        if source is None:
            solved[keys[0]] = number  # D4 begins with the identity
            related[cell.name] = cell
            continue
        fits = np.abs(images[:, source] - positions[number]).max(axis=-1) < 1e-6
        symmetry = list(D4)[int(np.argmax(fits))]
        related[cell.name] = replace(cell, source=names[source], symmetry=symmetry)
    return related
