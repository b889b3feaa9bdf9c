"""The inverse elasticity of a study: its sensor, constitutive models and the camera of the images that are learnt from."""

from __future__ import annotations

from gelforge.config import Camera, Study
from gelforge.learning.elasticity.inverse import Inverse
from gelforge.learning.elasticity.operator import flow_operator
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.virtual_lab.particles import VirtualLabError


class NoOperator(ValueError):
    """Why a study has no inverse elasticity, and what would give it one."""


def inverse_of(study: Study, laws: dict[str, PrincipalLaw], views: dict[str, dict]) -> Inverse:
    """Return the inverse of a study's sensor.

    Parameters
    ----------
    study : Study
        A block of hexahedra with particles.
    laws : dict of str to PrincipalLaw
        By material [MPa].
    views : dict of str to dict
        Of its images by session, as `view_of`.

    Returns
    -------
    Inverse
        From image flow [px] to forces on bins [N].

    Raises
    ------
    NoOperator
        Where the sensor is no block of hexahedra with particles, or its one camera is not described.
    """
    if study.tetrahedra:
        raise NoOperator("the sensor is no block of hexahedra")
    camera, crop_px = _camera_of(views)
    missing = sorted({layer.material for layer in study.sensor.layers} - laws.keys())
    if missing:
        raise NoOperator(
            f"materials {', '.join(missing)} have no constitutive model; run the study's material fits"
        )
    # mm; only how deep the camera sees depends on it
    particle = study.synthesis.particles.diameter_mm if study.synthesis else 0.3
    dots = study.synthesis.particles.dots if study.synthesis else None
    if not dots and not any(layer.particle_volume_fraction for layer in study.sensor.layers):
        raise NoOperator("no layer has particle_volume_fraction, and synthesis.particles has no dots")
    by_layer = {layer.name: laws[layer.material] for layer in study.sensor.layers}
    try:
        operator = flow_operator(
            study.sensor, study.mechanics, by_layer, camera, study.features.regions, crop_px, particle, dots
        )
    except VirtualLabError as error:
        raise NoOperator(str(error)) from None
    if not operator.any():
        raise NoOperator("the camera sees no gel; correct its pose")
    return Inverse.of(operator, study.mechanics.friction)


def _camera_of(views: dict[str, dict]) -> tuple[Camera, list[int] | None]:
    """Return the camera of all images and the part of them that is used."""
    kinds = {str((view["camera"], view["crop_px"])): view for view in views.values()}
    if not kinds or any(view["camera"] is None for view in kinds.values()):
        raise NoOperator("no camera is described; describe it in session.yaml or synthesis.camera")
    if len(kinds) > 1:
        raise NoOperator(
            f"the images are of {len(kinds)} cameras; bring them to one view (`remap` in session.yaml)"
        )
    view = next(iter(kinds.values()))
    return Camera.model_validate(view["camera"]), view["crop_px"]
