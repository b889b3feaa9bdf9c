"""Whether constitutive models are stable as far as a plan may stretch them; known before anything is solved."""

from __future__ import annotations

from gelforge.config import Study
from gelforge.indentation.effects.material import check_laws, region_laws, stretches_ahead
from gelforge.indentation.paths.planned_cell import PlannedCell
from gelforge.indentation.paths.trajectory import Trajectory
from gelforge.indentation.planning.reach import planned_reach
from gelforge.indentation.sensor.indenter_shapes import real_indenter, shape_of
from gelforge.mechanics.laws.law import PrincipalLaw


def check_stable_ahead(study: Study, laws: dict[str, PrincipalLaw], cells: dict[str, PlannedCell]) -> None:
    """Refuse laws that are unstable at a stretch that the deepest site of the plan may reach.

    The same check stands before every solution (simulate.model_of); here it needs no mesh.

    Parameters
    ----------
    study : Study
        Sensor, indenter, mechanics and approach.
    laws : dict of str to PrincipalLaw
        By material [MPa].
    cells : dict of str to PlannedCell
        Sites of the plan, at least one.

    Raises
    ------
    ConfigError
        Names layer, load case and stretch.
    """
    sensor, effects = study.sensor, study.mechanics.effects
    if study.mechanics.strain != "finite":  # small strains use the laws at rest only
        return
    shape = real_indenter(shape_of(study.indenter), effects)
    deepest = max(cells.values(), key=lambda cell: cell.deepest_mm)
    share = planned_reach(sensor, effects, shape, Trajectory.of(deepest, study.plan.approach)).share
    regions = tuple(layer.name for layer in sensor.layers)
    by_layer = sensor.by_layer(laws)
    used = region_laws(sensor, effects, regions, by_layer)
    check_laws(used, stretches_ahead(sensor, effects, by_layer, regions, share))
