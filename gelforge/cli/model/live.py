"""`gelforge live`: forces of a camera as they come."""

from __future__ import annotations

from pathlib import Path


def live(
    source: str,
    model: Path,
    reference: Path | None,
    crop: list[int] | None,
    camera: Path | None,
    plane_z_mm: float | None,
    host: str,
    port: int,
    record: Path | None,
    fps: float,
    loop: bool,
    browser: bool,
    max_recordings: int | None,
    max_recording_mb: float | None,
) -> None:
    """Serve forces of a source until it ends or Ctrl-C; the page's address is printed."""
    import gc
    import webbrowser

    from gelforge.config import load_camera
    from gelforge.learning.deployment.predictor import Predictor
    from gelforge.live.capture import played
    from gelforge.live.compute import LiveForce
    from gelforge.live.messages import about
    from gelforge.live.record import LIMITS, Limits
    from gelforge.live.run import run_live
    from gelforge.live.server import Server
    from gelforge.recording.imaging.flow import read_grey

    count = LIMITS.recordings if max_recordings is None else max_recordings
    limits = Limits(count, LIMITS.largest_mb if max_recording_mb is None else max_recording_mb)
    zero = read_grey(reference) if reference else None
    open_source = played(source, fps, loop)
    predictor = Predictor(model)
    force = LiveForce(predictor, zero, crop, load_camera(camera) if camera else None, plane_z_mm)
    described = about(predictor.model.settings, predictor.model.model_sha256, source)
    if described["synthetic"]:
        print(
            f"SYNTHETIC: this model was trained on {described['trained_on'] or 'images that a virtual lab made'}"
        )
    if zero is None:
        print("the first frame is taken as the reference: nothing must touch the sensor now")
    gc.collect()
    gc.freeze()  # else Python looks through all that was imported every ten seconds, and forces stop for one
    with Server(host, port, described) as server:
        print(
            f"page {server.url}   stream {server.url.replace('http', 'ws', 1)}stream   stop: Ctrl-C",
            flush=True,
        )
        if browser:
            webbrowser.open(server.url)
        try:
            run_live(open_source, force, server, record, lambda text: print(text, flush=True), limits)
        except KeyboardInterrupt:
            print("stopped")
