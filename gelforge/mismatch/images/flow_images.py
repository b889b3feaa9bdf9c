"""Mean optical flow of coarse regions of the image: as the session's images show it, and as the moved gel would show it.

The session's own untouched image is warped by the gel's mean motion and searched as its images are (recording.flow): the
search fills the gaps between particles and shrinks what it finds, and both are then in the prediction, of these particles as
they look. That particles move by their heights and cover one another no warp shows: by how much the flow then differs is
drawn (virtual_lab.imaging), with particles placed at random in the layers that carry them. What stays open is at which
height each real one is.

Changes are too small for that: which particles lie in a region scatters by more than an effect changes. They are mean
motions of points that fill the layers evenly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.sparse import csr_array
from scipy.special import ndtr
from scipy.stats import qmc

from gelforge.config import Camera, Sensor, VirtualImaging, VirtualParticles, given
from gelforge.mismatch.readings.observations import Observations, spread_out
from gelforge.mismatch.readings.sessions import read_all
from gelforge.recording.imaging.flow import Flow, crop, read_grey
from gelforge.recording.imaging.images import image_path, reference_path
from gelforge.recording.imaging.warp import enlarged, warped
from gelforge.recording.optics.camera import image_axes, project
from gelforge.recording.readings import Recording
from gelforge.virtual_lab.imaging import draw, expose
from gelforge.virtual_lab.particles import gel_boxes, place_particles

# Along each side: 15 to 20 particles per region of the published sensor's gel. With so many a region's mean differs by 10 to
# 12 % by where they lie (benchmarks/flow_changes.py).
REGIONS = 8
PRESET = "fine"  # of the flow, as the factory's features
SPREAD_PX = 10.0  # over which the search spreads what it finds: about the distance of particles in the image
# Largest mean motion of a region in an image that is looked at. Where particles move farther the search mistakes some:
# at 6 px the flow in drawn images grows by twice what the gel's motion grows by, at 2 px by 1.05 (measured on the demo).
MOST_PX = 2.5


@dataclass(frozen=True)
class CameraView:
    """The camera of one session and how its images look."""

    camera: Camera
    crop_px: tuple[int, ...] | None
    imaging: VirtualImaging

    @property
    def frame(self) -> tuple[int, ...]:
        """Return left, top, width and height [px] of the image in that of the camera."""
        return self.crop_px or (0, 0, self.camera.width_px, self.camera.height_px)

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return where points (Q, 3) [mm] are seen (Q, 2) [px] in the frame of the camera; u, v."""
        return project(pinhole(self.camera), points)[0]

    def in_frame(self, pixels: np.ndarray) -> np.ndarray:
        """Return u and v (2, Q) [px] from the image's upper left corner."""
        left, top, *_ = self.frame
        return (pixels - [left - 0.5, top - 0.5]).T


@dataclass(frozen=True)
class FlowObservation:
    """The flow of one indentation at a commanded depth."""

    row: pd.Series  # of the table of observations: the last held reading there
    eye: CameraView
    flow: np.ndarray  # (m, 2) mean over its images [px], m regions row by row from the top left; u, v
    noise: np.ndarray  # (m, 2) [px] standard deviation of one image's region mean by the images' noise
    images: int
    untouched: np.ndarray  # (H, W) uint8, the session's image at zero force


@dataclass(frozen=True)
class Particles:
    """Placements of particles that could be the sensor's."""

    placed: tuple[np.ndarray, ...]  # each (P, 3) [mm]
    diameter_mm: float

    @cached_property
    def points(self) -> np.ndarray:
        """Return all of them (sum of P, 3)."""
        return np.concatenate(self.placed)

    def first(self, count: int) -> Particles:
        """Return the first placements alone."""
        return Particles(self.placed[:count], self.diameter_mm)

    def by_point(self, field: np.ndarray) -> list[np.ndarray]:
        """Return a quantity (sum of P, ...) of all points by placement."""
        return np.split(field, np.cumsum([len(p) for p in self.placed])[:-1])


def likely_particles(sensor: Sensor, seed: int, drawings: int = 32) -> Particles:
    """Return placements at the sensor's volume fraction. Raises VirtualLabError where no layer carries particles.

    drawings: how many, for the mean of drawn images and its scatter. Their diameter is that of the virtual lab's default,
    0.3 mm: no file of a session states it.
    """
    share = max(layer.particle_volume_fraction for layer in sensor.layers)
    settings = VirtualParticles(**({"volume_fraction": min(share, 0.1)} if share > 0 else {}))
    placed = [place_particles(settings, sensor, f"flow {seed} {k}") for k in range(drawings)]
    return Particles(tuple(placed), settings.diameter_mm)


def even_points(sensor: Sensor, diameter_mm: float) -> np.ndarray:
    """Return points (Q, 3) [mm] that fill the layers with particles evenly, where middles of particles can be."""
    boxes = [(low + diameter_mm / 2, high - diameter_mm / 2) for low, high in gel_boxes(sensor)]
    volumes = np.array([np.prod(high - low) for low, high in boxes])
    even = qmc.Sobol(3, scramble=False).random_base2(14)
    counts = np.round(len(even) * volumes / volumes.sum()).astype(int)
    return np.concatenate([low + even[:n] * (high - low) for (low, high), n in zip(boxes, counts)])


def mean_motion(
    eye: CameraView, points: np.ndarray, moved: np.ndarray, seen: np.ndarray | float = 1.0
) -> np.ndarray:
    """Return the mean motion (m, 2) [px] in the image of points (Q, 3) [mm] seen in each region, moved by (Q, 3) [mm].

    seen: (Q,) by how much each point counts.
    """
    pixels = eye.pixels(points)
    return _parts_of_regions(eye, pixels, seen).T @ (eye.pixels(points + moved) - pixels)


def mean_motion_slope(
    eye: CameraView, points: np.ndarray, moved: np.ndarray, weights: csr_array
) -> np.ndarray:
    """Return d mean motion / d displacement (m, 2, G, 3) [px/mm] of nodes, whose weights at the points are (Q, G)."""
    part = _parts_of_regions(eye, eye.pixels(points))
    slopes, size = [], 1e-3  # mm, over which the projection's curvature is 1e-5 of its slope
    for step in size * np.eye(3):
        there, back = (eye.pixels(points + moved + sign * step) for sign in (1, -1))
        slopes.append((there - back) / (2 * size))
    by_node = [[(weights.T @ (part * along[:, k, None])).T for along in slopes] for k in range(2)]
    return np.moveaxis(np.array(by_node), (0, 1, 2, 3), (1, 3, 0, 2))


def _parts_of_regions(eye: CameraView, pixels: np.ndarray, weight: np.ndarray | float = 1.0) -> np.ndarray:
    """Return the weights (Q, m) of points seen at pixels (Q, 2) in each region's mean; they add up to 1 over the points."""
    (u, v), (*_, width, height) = eye.in_frame(pixels), eye.frame
    rows, columns = _within(v, height), _within(u, width) * np.reshape(weight, (-1, 1))
    part = (rows[:, :, None] * columns[:, None, :]).reshape(len(pixels), -1)
    return part / np.maximum(part.sum(axis=0), np.finfo(float).tiny)


def _within(at: np.ndarray, pixels: int, parts: int = REGIONS) -> np.ndarray:
    """Return the share (Q, parts) of each part of an axis in what the search spreads from places (Q,) [px]."""
    edges = np.arange(parts + 1) * pixels / parts
    return np.diff(ndtr((edges - at[:, None]) / SPREAD_PX), axis=1)


def region_middles(eye: CameraView) -> np.ndarray:
    """Return the middles (m, 2) [px] of the regions in the image as it was taken, row by row from the top left; u, v."""
    left, top, width, height = eye.frame
    u = left + (np.arange(REGIONS) + 0.5) * width / REGIONS - 0.5
    v = top + (np.arange(REGIONS) + 0.5) * height / REGIONS - 0.5
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def away_from_indenter(press: FlowObservation) -> np.ndarray:
    """Return how far the middle of each region (m,) [px] is from where the indenter's lowest point touches."""
    contact = np.array([[press.row["x_mm"], press.row["y_mm"], 0.0]], dtype=float)
    return np.linalg.norm(region_middles(press.eye) - press.eye.pixels(contact), axis=1)


def region_means(flow: np.ndarray) -> np.ndarray:
    """Return the mean (m, 2) of a flow (H, W, 2) over REGIONS x REGIONS equal parts, by area."""
    rows, columns = (_shares(pixels) for pixels in flow.shape[:2])
    return np.einsum("ih,hwc,jw->ijc", rows, flow, columns, optimize=True).reshape(-1, 2)


def _shares(pixels: int) -> np.ndarray:
    """Return the share (REGIONS, pixels) of each pixel of an axis in a region's mean."""
    edges = np.arange(REGIONS + 1)[:, None] * pixels / REGIONS
    start = np.arange(pixels)[None, :]
    return np.clip(np.minimum(edges[1:], start + 1) - np.maximum(edges[:-1], start), 0, 1) * REGIONS / pixels


def seen_flows(
    sessions: Sequence[Path | Recording],
    observations: Observations,
    sensor: Sensor,
    depth_mm: float | None = None,
    most_sites: int = 12,
) -> list[FlowObservation]:
    """Return the flow of one indentation at each of so many sites at most, of sessions with images that say their camera.

    The first site, then always the farthest from those. depth_mm: the nearest to it that has images; None: to the deepest
    at which the first site moves no region by more than MOST_PX, or the smallest.
    """
    held = observations.table[observations.table["phase"].isin(["load", "dwell"])]
    by_site: dict[int, list[Pictured]] = {}
    for recording in read_all(sessions, sensor):
        rows = recording.readings[
            (recording.readings["phase"] == "dwell") & (recording.readings["image"] != "")
        ]
        if recording.session.camera is None or rows.empty:
            continue
        name = recording.session.session
        for (press, depth), images in rows.groupby(["press", "depth_mm"], sort=False):
            matching = held[(held["press"] == f"{name}/{press}") & np.isclose(held["depth_mm"], depth)]
            if len(matching):
                one = Pictured(recording, str(press), matching.iloc[-1], tuple(images["image"]))
                by_site.setdefault(int(one.row["site"]), []).append(one)
    if not by_site:
        return []
    sites = sorted(by_site)
    chosen = [sites[k] for k in spread_out(observations.sites[sites], most_sites, 0)]
    depth = _depth_seen(by_site[chosen[0]]) if depth_mm is None else depth_mm
    nearest = [min(by_site[site], key=lambda one: abs(one.depth_mm - depth)) for site in chosen]
    return _with_common_noise([_measured(one) for one in nearest])


@dataclass(frozen=True, eq=False)
class Pictured:
    """An indentation of which there are images."""

    recording: Recording
    press: str
    row: pd.Series  # of the table of observations: the last held reading there
    images: tuple[str, ...]

    @property
    def depth_mm(self) -> float:
        """Return the commanded depth."""
        return float(self.row["depth_mm"])


def _depth_seen(pictured: Sequence[Pictured]) -> float:
    """Return the largest depth [mm] at which no region moves by more than MOST_PX; the smallest where all do."""
    deepest_first = sorted(pictured, key=lambda one: -one.depth_mm)
    for one in deepest_first:
        if np.linalg.norm(_measured(one).flow, axis=1).max() <= MOST_PX:
            return one.depth_mm
    return deepest_first[-1].depth_mm


def _with_common_noise(seen: list[FlowObservation]) -> list[FlowObservation]:
    """Return the indentations with the noise of images averaged: each region's over all, that of grey over a session's.

    Where a region has no texture the search finds anything.
    """
    noise = np.sqrt(np.mean([press.noise**2 for press in seen], axis=0))
    greys = pd.Series([press.eye.imaging.noise_grey for press in seen])
    grey = np.sqrt((greys**2).groupby([press.row["session"] for press in seen]).transform("mean"))
    observed = []
    for press, noise_grey in zip(seen, grey):
        imaging = press.eye.imaging.model_copy(update={"noise_grey": float(noise_grey)})
        observed.append(replace(press, noise=noise, eye=replace(press.eye, imaging=imaging)))
    return observed


def _measured(one: Pictured) -> FlowObservation:
    recording, press, images = one.recording, one.press, one.images
    crop_px = recording.session.crop_px
    reference = read_grey(reference_path(recording.folder), crop_px)
    pictures = [read_grey(image_path(recording.folder, name), crop_px) for name in images]
    search = Flow(reference, PRESET)
    flows = np.stack([region_means(search(picture)) for picture in pictures])  # (I, m, 2)
    zeros = recording.readings
    zeros = zeros[(zeros["press"] == press) & (zeros["phase"] == "zero") & (zeros["image"] != "")]["image"]
    still = [read_grey(image_path(recording.folder, name), crop_px) for name in zeros[:1]]
    if len(pictures) > 1:
        noise = flows.std(axis=0, ddof=1)
        grey = float(np.std(pictures[0].astype(float) - pictures[1])) / np.sqrt(2)
    elif still:  # two images of the untouched gel differ by the noise of both
        noise = np.abs(region_means(search(still[0]))) / np.sqrt(2)
        grey = float(np.std(still[0].astype(float) - reference)) / np.sqrt(2)
    else:
        noise, grey = np.full(flows.shape[1:], np.nan), VirtualImaging().noise_grey
    low, high = np.percentile(reference, (5.0, 99.5))  # background, and the nearest particles' middles
    imaging = VirtualImaging(noise_grey=grey, background_grey=float(low), particle_grey=float(high))
    eye = CameraView(
        given(recording.session.camera, "camera"), None if crop_px is None else tuple(crop_px), imaging
    )
    return FlowObservation(one.row, eye, flows.mean(axis=0), noise, len(images), reference)


class Scene:
    """Untouched particles before a camera, in every placement; draws what a motion of them shows."""

    def __init__(self, eye: CameraView, particles: Particles):
        self.eye, self.particles, self.camera = eye, particles, pinhole(eye.camera)
        self.untouched = [self._picture(points, k, 0) for k, points in enumerate(particles.placed)]
        self.searches = [Flow(picture, PRESET) for picture in self.untouched]

    def flows(self, moved: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Return by how much the regions' flow (K, m, 2) [px] in all placements is another than that of a mere warp.

        Points are displaced by moved (sum of P, 3) [mm]; the warp moves every pixel by field (H, W, 2) [px]. In both the
        particles are the same, at the same places of the image: they differ as particles move by their heights, and cover
        one another.
        """
        fields = self.particles.by_point(moved)
        differences = []
        for k, (search, points, field_of) in enumerate(zip(self.searches, self.particles.placed, fields)):
            drawn = region_means(search(self._picture(points + field_of, k, 1)))
            differences.append(drawn - flow_of_warp(search, self.untouched[k], field, self.eye.imaging, k))
        return np.stack(differences)

    def _picture(self, centres: np.ndarray, drawing: int, which: int) -> np.ndarray:
        """Return the image of particles with the noise of that drawing, the same for every motion."""
        drawn = draw(self.camera, self.eye.imaging, centres, self.particles.diameter_mm)
        noisy = expose(drawn, self.eye.imaging, np.random.default_rng([drawing, which]))
        return crop(noisy, None if self.eye.crop_px is None else list(self.eye.crop_px))


def flow_of_warp(
    search: Flow, untouched: np.ndarray, field: np.ndarray, imaging: VirtualImaging, drawing: int = 0
) -> np.ndarray:
    """Return the regions' flow (m, 2) [px] that the search finds in an untouched image (H, W) moved by field (H, W, 2)."""
    moved = expose(warped(untouched, field), imaging, np.random.default_rng([drawing, 2]))
    return region_means(search(moved))


def motion_field(eye: CameraView, points: np.ndarray, moved: np.ndarray, cells: int = 40) -> np.ndarray:
    """Return the mean motion (H, W, 2) float32 [px] of points (Q, 3) [mm] seen near each pixel, moved by (Q, 3) [mm].

    cells: along each side, between which it is interpolated; as wide as SPREAD_PX.
    """
    pixels = eye.pixels(points)
    motion = eye.pixels(points + moved) - pixels
    (u, v), (*_, width, height) = eye.in_frame(pixels), eye.frame
    rows, columns = _within(v, height, cells), _within(u, width, cells)
    seen = np.maximum(rows.T @ columns, np.finfo(np.float32).eps)  # far from all points nothing moves
    means = np.stack([rows.T @ (columns * motion[:, k, None]) / seen for k in range(2)], axis=-1)
    return enlarged(means, width, height)


def pinhole(camera: Camera) -> Camera:
    """Return a camera as a pinhole; a flat scale as one so far away that its rays are parallel."""
    if camera.focal_px is not None:
        return camera
    away_mm = 1e4  # rays are parallel within 1e-3
    far = np.asarray(camera.position_mm) - away_mm * image_axes(camera)[2]
    focal_px = away_mm / given(camera.mm_per_px, "camera.mm_per_px")
    changed = {"mm_per_px": None, "focal_px": focal_px, "position_mm": far.tolist()}
    return Camera(**(camera.model_dump() | changed))


def shows_gel(eye: CameraView, particles: Particles) -> np.ndarray:
    """Return (m,) bool: the regions in which particles are seen."""
    (u, v), (*_, width, height) = eye.in_frame(eye.pixels(particles.points)), eye.frame
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    row, column = (at[inside] * REGIONS // pixels for at, pixels in ((v, height), (u, width)))
    number = row.astype(int) * REGIONS + column.astype(int)
    count = np.bincount(number, minlength=REGIONS**2)
    # with fewer it shows the wall or the gel's rim
    return count >= max(0.5 * float(np.median(count[count > 0])), len(particles.placed))
