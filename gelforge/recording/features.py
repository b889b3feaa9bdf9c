"""Image features: the flow's magnitude and direction averaged over equal regions of the image."""

from __future__ import annotations

import json
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import islice
from pathlib import Path

import cv2
import h5py
import numba
import numpy as np
import pandas as pd

from gelforge.config import Features, Session
from gelforge.files import digest
from gelforge.hdf5 import writing
from gelforge.progress import Progress
from gelforge.recording.imaging.flow import Flow, ImageError
from gelforge.recording.imaging.image_digest import images_digest
from gelforge.recording.imaging.image_measures import Measurer, Measures, add_measures
from gelforge.recording.imaging.images import image_path, reference_path
from gelforge.recording.optics.remap import picture_of, read_as, seen_by, view_of
from gelforge.recording.plausibility.findings import Findings, collect
from gelforge.recording.plausibility.image_series import series_of
from gelforge.recording.plausibility.images import IMAGE_TESTS, flow_lost_of
from gelforge.recording.plausibility.session import refuse
from gelforge.recording.readings import Recording, raw_digest, sample_rows
from gelforge.recording.tables.checks import before_shear

FORMAT = "gelforge-features-1"
OF_ANY_IMAGE = {"image_readable", "image_content", "image_exposure"}  # tests that compare no motions

# name: (unit, description), N images
DATASETS = {
    "session": ("1", "session (N)"),
    "press": ("1", "indentation (N)"),
    "cell": ("1", "site of the plan (N)"),
    "order": ("1", "order of the indentation within the session (N)"),
    "phase": ("1", "zero, load or dwell, of a path also shear and unload (N)"),
    "image": ("1", "file name of the image (N)"),
    "image_index": ("1", "number of the image within its indentation, from 0 (N)"),
    "step": (
        "1",
        "step of its site's path that the indentation follows, -1: of none; absent without paths (N)",
    ),
    "position_mm": ("mm", "commanded position in the sensor frame (N, 2)"),
    "depth_mm": ("mm", "commanded depth, 0 for untouched rows (N)"),
    "force_N": (
        "N",
        "measured force on the sensor in the sensor frame, zero subtracted; NaN: excluded (N, 3)",
    ),
    "flow_px": ("px", "root mean square of the flow's length over the image (N)"),
    "flow_lost": (
        "1",
        "share of the textured pixels whose flow does not fit the image, of the first image of an indentation before"
        " contact and at depth (N)",
    ),
    "feature": (
        "px, rad",
        "m magnitudes, then m directions; regions row by row from the image's top left (N, 2 m)",
    ),
}


def flow_features(flow: np.ndarray, regions: int, moved_px: float, scale: float = 1.0) -> np.ndarray:
    """Return the features of a flow: mean magnitude and direction of each region.

    The image has regions x regions = m equal parts; a pixel on a border counts in both by its area. The direction of a
    region is atan2 of the mean sine and the mean cosine over its pixels that moved more than moved_px (u to the right, v
    down), 0 where none did.

    Parameters
    ----------
    flow : numpy.ndarray
        (H, W, 2) [px] of images reduced to `scale`.
    regions : int
        Along each side.
    moved_px : float
        In pixels of the image before it was reduced.
    scale : float
        Share of its size to which the image was reduced.

    Returns
    -------
    numpy.ndarray
        (2 m) float32: m magnitudes [px of the image before], then m directions [rad in (-pi, pi]].
    """
    rows, columns = _pixel_shares(flow.shape[0], regions), _pixel_shares(flow.shape[1], regions)
    sums = _region_sums(flow, regions, np.float32(moved_px * scale), *rows, *columns)  # (r, r, 3)
    area = flow.shape[0] * flow.shape[1] / regions**2  # px of a region, of the flow's own
    direction = np.arctan2(sums[..., 2], sums[..., 1]).astype(np.float32)
    direction[direction == -np.float32(np.pi)] = np.pi  # one name for the direction to the left
    return np.concatenate([(sums[..., 0] / (area * scale)).astype(np.float32).ravel(), direction.ravel()])


@lru_cache(maxsize=8)
def _pixel_shares(pixels: int, regions: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the region (pixels,) in which each pixel of an axis begins, and its share (pixels,) there.

    The rest of the pixel lies in the next region; no pixel reaches three, as there are no more regions than pixels.
    """
    start = np.arange(pixels)
    first = start * regions // pixels
    # the region ends at (first + 1) pixels / regions
    share = np.minimum(1.0, (first + 1) * pixels / regions - start)
    return first, share.astype(np.float32)


@numba.njit(cache=True, nogil=True)
def _region_sums(flow, regions, moved_px, row_first, row_share, column_first, column_share):
    """Return sums (r, r, 3) over each region's pixels, by area: magnitude, and cosine and sine of those that moved."""
    sums = np.zeros((regions + 1, regions + 1, 3))  # one more takes the empty rest of the last pixels
    of_row = np.zeros((regions + 1, 3), dtype=np.float32)
    for y in range(flow.shape[0]):
        of_row[:] = 0
        for x in range(flow.shape[1]):
            u, v = flow[y, x, 0], flow[y, x, 1]
            magnitude = np.sqrt(u * u + v * v)
            cosine, sine = np.float32(0), np.float32(0)
            if magnitude > moved_px:
                cosine, sine = u / magnitude, v / magnitude
            i, a = column_first[x], column_share[x]
            of_row[i, 0] += a * magnitude
            of_row[i, 1] += a * cosine
            of_row[i, 2] += a * sine
            if a < 1:
                of_row[i + 1, 0] += (1 - a) * magnitude
                of_row[i + 1, 1] += (1 - a) * cosine
                of_row[i + 1, 2] += (1 - a) * sine
        j, b = row_first[y], row_share[y]
        for i in range(regions):
            for k in range(3):
                sums[j, i, k] += b * of_row[i, k]
                sums[j + 1, i, k] += (1 - b) * of_row[i, k]
    return sums[:regions, :regions]


class FlowFeatures:
    """The features of images against one reference frame: the path that sessions and the live predictor share.

    Reference and images come reduced to settings.image_scale (`picture_of`). Not shared between threads, as `Flow`.
    """

    def __init__(self, reference: np.ndarray, settings: Features):
        if min(reference.shape) < settings.regions:
            raise ImageError(
                f"image of {reference.shape[1]} x {reference.shape[0]} px is smaller than features.regions "
                f"{settings.regions}; use fewer regions"
            )
        self.flow = Flow(reference, settings.flow_preset)
        self.settings = settings

    def __call__(self, image: np.ndarray) -> np.ndarray:
        """Return the features (2 m) float32 of an image (H, W) uint8."""
        return self.of_flow(self.flow(image))

    def of_flow(self, flow: np.ndarray) -> np.ndarray:
        """Return the features (2 m) float32 of an image's flow (H, W, 2)."""
        settings = self.settings
        return flow_features(flow, settings.regions, settings.moved_px, settings.image_scale)


def session_features(recording: Recording, settings: Features, out: str | Path, workers: int = 1) -> int:
    """Write the features of a recording's zero, load and dwell images to an HDF5 file.

    Images are read, reduced and written in batches: memory does not grow with the session. The result does not depend on
    the number of workers. Images that a test of the session excludes are left out.

    Parameters
    ----------
    recording : Recording
        As `read_recording` returns it.
    settings : Features
        Regions, flow and scale of the study.
    out : str or Path
        The file.
    workers : int
        Threads.

    Returns
    -------
    int
        Number of images.

    Raises
    ------
    ImageError
        For a session without images, and for an image that cannot be decoded.
    RecordingError
        Where the images as a whole cannot be true.
    """
    if workers > 1:
        cv2.setNumThreads(1)  # one image per thread is faster than several threads on one image
    rows = sample_rows(recording)
    rows = rows[rows["image"] != ""]
    if rows.empty:
        raise ImageError(
            f"{recording.folder}: session {recording.session.session} has no images; it is force-only"
        )
    made_of = features_digest(recording.folder, recording.session, settings)  # of the images as they are now
    with writing(out, track_order=True) as file:
        m2 = 2 * settings.regions**2
        shape = {"shape": (len(rows), m2), "maxshape": (None, m2), "chunks": (min(16, len(rows)), m2)}
        feature = file.create_dataset("feature", dtype="f4", **shape)
        _describe(feature, "feature")
        measures: list[Measures] = []
        with Progress(f"images of session {recording.session.session}", len(rows)) as progress:
            for batch in _features_in_batches(recording, settings, rows, workers):
                vectors, measured = zip(*batch)
                feature[len(measures) : len(measures) + len(vectors)] = np.stack(vectors)
                measures += measured
                progress.advance(len(batch))
        table = add_measures(rows.assign(run=0), measures)
        table["flow_lost"] = table.groupby(["press", "phase"], sort=False)["flow_lost"].ffill()
        judged = judge_all(recording, table, settings.image_scale)
        left_out = table.index.isin(judged.excluded_rows("image"))
        _keep(feature, np.flatnonzero(~left_out))
        file.attrs["digest"] = made_of
        _write_attributes(file, recording, settings, table[left_out], judged)
        _write_rows(file, table[~left_out])
    return int((~left_out).sum())


def judge_all(recording: Recording, table: pd.DataFrame, scale: float) -> Findings:
    """Return what the image tests find in all images of a session, and which indentations the flow cannot follow.

    A sample was judged when the session was read. Tests of the motion see loading alone. scale: features.image_scale, by
    which the images were reduced. Raises RecordingError where an error is found.
    """
    session = recording.session
    reference = read_as(picture_of(session, scale), reference_path(recording.folder))
    loading = table[before_shear(table) & (table["phase"] != "unload")]
    every, series = (series_of(rows, reference, seen_by(session)) for rows in (table, loading))
    findings = [
        f for name, test in IMAGE_TESTS.items() for f in test(every if name in OF_ANY_IMAGE else series)
    ]
    judged = collect(session.session, [*findings, *flow_lost_of(every.shown)], session.confirmed)
    refuse(recording.folder, judged)
    return judged


def _keep(feature: h5py.Dataset, rows: np.ndarray) -> None:
    """Move the rows kept to the front of a dataset and cut the rest off."""
    size = 64  # rows in memory at a time
    for start in range(0, len(rows), size):
        block = rows[start : start + size]
        if block[-1] >= start + len(block):  # something before it was left out
            feature[start : start + len(block)] = feature[block]
    feature.resize(len(rows), axis=0)


def found_in(path: str | Path) -> list[str]:
    """Return what the image tests found when a file of features was made, a line per test.

    Parameters
    ----------
    path : str or Path
        The file of features.

    Returns
    -------
    list of str
        Empty where they found nothing.
    """
    with h5py.File(path, "r") as file:
        return json.loads(file.attrs["findings"])


def features_digest(folder: str | Path, session: Session, settings: Features) -> str:
    """Return the digest of what decides a session's features, its images included; a join compares it.

    Parameters
    ----------
    folder : str or Path
        Of the session.
    session : Session
        Its keys.
    settings : Features
        Of the study.

    Returns
    -------
    str
        SHA-256 in hexadecimal.
    """
    described = {"session": session.model_dump(mode="json"), "features": settings.model_dump(mode="json")}
    return digest(described | {"raw": raw_digest(folder), "images": images_digest(folder)})


def _features_in_batches(
    recording: Recording, settings: Features, rows: pd.DataFrame, workers: int
) -> Iterator[list[tuple[np.ndarray, Measures]]]:
    """Yield features (2 m) and measures of a recording's images in their order, 64 at a time.

    Whether the flow fits the image is measured of the first image of an indentation before contact, at depth and at each
    step of a path.
    """
    picture = picture_of(recording.session, settings.image_scale)
    reference = read_as(picture, reference_path(recording.folder))
    local = threading.local()

    def features(name: str, first: bool) -> tuple[np.ndarray, Measures]:
        if not hasattr(local, "extract"):
            local.extract = FlowFeatures(reference, settings)
            local.measure = Measurer(local.extract.flow, settings.image_scale)
        path = image_path(recording.folder, name)
        image = read_as(picture, path)
        try:
            flow = local.extract.flow(image)
        except ImageError as error:
            raise ImageError(f"{path}: {error}") from None
        return local.extract.of_flow(flow), local.measure(image, flow, with_lost=first)

    names, firsts = iter(rows["image"]), iter(~rows.duplicated(["press", "phase", "step"]))
    with ThreadPoolExecutor(workers) as pool:
        while batch := list(islice(names, 64)):
            yield list(pool.map(features, batch, islice(firsts, len(batch))))


def _write_attributes(
    file: h5py.File, recording: Recording, settings: Features, left_out: pd.DataFrame, judged: Findings
) -> None:
    """Write what made the file; excluded_images: by indentation, how many at its depth a test of the session took out."""
    session = recording.session
    file.attrs["format"] = FORMAT
    file.attrs["session"] = session.session
    file.attrs["synthetic"] = session.synthetic
    file.attrs["view"] = json.dumps(view_of(session, settings.image_scale), sort_keys=True)
    excluded = Counter(recording.excluded_images)
    excluded.update(left_out.loc[left_out["phase"] != "zero", "press"])
    file.attrs["excluded_images"] = json.dumps(dict(excluded))
    file.attrs["findings"] = json.dumps(judged.lines("excluded", "note"))


def _write_rows(file: h5py.File, rows: pd.DataFrame) -> None:
    """Write what is known of each image before its features."""
    text = h5py.string_dtype()
    for name in ("session", "press", "cell", "phase", "image"):
        file.create_dataset(name, data=rows[name].to_numpy(object), dtype=text)
    if (rows["step"] >= 0).any():
        file["step"] = rows["step"].to_numpy(np.int64)
    file["order"] = rows["order"].to_numpy(np.int64)
    file["image_index"] = rows.groupby("press", sort=False).cumcount().to_numpy(np.int64)
    file["position_mm"] = rows[["x_mm", "y_mm"]].to_numpy(float)
    file["depth_mm"] = rows["depth_mm"].where(rows["phase"] != "zero", 0.0).to_numpy(float)
    file["force_N"] = rows[["fx_N", "fy_N", "fz_N"]].to_numpy(float)
    file["flow_px"], file["flow_lost"] = rows["flow_px"].to_numpy("f4"), rows["flow_lost"].to_numpy("f4")
    for name in file:
        _describe(file[name], name)


def _describe(data: h5py.Dataset, name: str) -> None:
    data.attrs["units"], data.attrs["description"] = DATASETS[name]
