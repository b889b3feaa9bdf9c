"""Image series of a simulated sensor: particles or dots drawn where presses move them, and reduced to features."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from gelforge.config import Camera, Study, VirtualImaging, given
from gelforge.recording.features import FlowFeatures
from gelforge.recording.imaging.flow import reduced
from gelforge.synthesis.drawn_press import DrawnPress
from gelforge.virtual_lab.imaging import as_read, draw, expose, focused
from gelforge.virtual_lab.particles import place_particles


def series_features(
    study: Study, presses: Iterable[DrawnPress], serial: str, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Yield the features of the untouched sensor and of each indentation, seen in one image series. No image is kept.

    Parameters
    ----------
    study : Study
        With `synthesis` and features.
    presses : iterable of DrawnPress
        With the motion of the gel.
    serial : str
        Of the sensor; it places the particles.
    rng : numpy.random.Generator
        Draws camera, light and noise.

    Yields
    ------
    numpy.ndarray
        (2 m) float32, as `flow_features` returns it.
    """
    synthesis = given(study.synthesis, "synthesis")
    particles = place_particles(synthesis.particles, study.sensor, serial)
    camera, imaging = _view(study, rng)
    imaging = focused(imaging, particles)
    diameter, flat = synthesis.particles.diameter_mm, synthesis.particles.dots is not None

    def seen(moved: np.ndarray) -> np.ndarray:
        image = expose(draw(camera, imaging, particles + moved, diameter, flat), imaging, rng)
        return reduced(image, study.features.image_scale)

    extract = FlowFeatures(seen(np.zeros(3)), study.features)
    yield extract(seen(np.zeros(3)))
    for press in presses:
        yield extract(seen(press.moved(particles)))


def _view(study: Study, rng: np.random.Generator) -> tuple[Camera, VirtualImaging]:
    """Return camera and imaging of one image series, drawn about the study's."""
    synthesis = given(study.synthesis, "synthesis")
    views, camera, imaging = synthesis.views, synthesis.camera, as_read(synthesis.imaging)
    away = {
        "focal_px": given(camera.focal_px, "synthesis.camera.focal_px")
        * (1 + views.focal_share * rng.standard_normal()),
        "centre_px": list(np.add(camera.centre_px, views.centre_px * rng.standard_normal(2))),
        "rotation_deg": list(np.add(camera.rotation_deg, views.rotation_deg * rng.standard_normal(3))),
    }
    light = max(1 + views.brightness_share * rng.standard_normal(), 0.2)
    drawn = {
        "background_grey": min(light * imaging.background_grey, 255.0),
        "particle_grey": min(light * imaging.particle_grey, 255.0),
        "blur_px": imaging.blur_px * max(1 + views.blur_share * rng.standard_normal(), 0.0),
        "noise_grey": imaging.noise_grey * max(1 + views.noise_share * rng.standard_normal(), 0.0),
    }
    return camera.model_copy(update=away), imaging.model_copy(update=drawn)
