"""Whether recorded images are of the kind that a model learnt from: regions, size, and whether they are mirrored."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from gelforge.dataset.shard import shard_attributes
from gelforge.learning.basis.scaling import ModelError
from gelforge.learning.models.model_file import Model


def views_of(shards: Sequence[str | Path]) -> dict[str, dict]:
    """Return by session what a dataset's images are.

    Parameters
    ----------
    shards : sequence of str or Path
        All shards of the dataset.

    Returns
    -------
    dict of str to dict
        As `view_of`; empty for a session without a view.
    """
    sessions = {n: about for path in shards for n, about in shard_attributes(path)["sessions"].items()}
    return {name: about.get("view") or {} for name, about in sorted(sessions.items())}


def check_same_images(model: Model, regions: int, views: dict[str, dict]) -> None:
    """Refuse recorded images that are not of the model's kind.

    Parameters
    ----------
    model : Model
        Its settings state what it was trained on.
    regions : int
        Image regions a side of the features.
    views : dict of str to dict
        By session, as `view_of`.

    Raises
    ------
    ModelError
        Names what differs and the keys that settle it.
    """
    of_model = model.settings["features"]["regions"]
    if regions != of_model:
        raise ModelError(
            f"features of {regions} regions a side, but the model reads {of_model}; set features.regions: {of_model}"
        )
    learnt = [view for view in (model.settings.get("views") or {}).values() if view]
    for session, view in views.items():
        if view and learnt and not any(_alike(view, other) for other in learnt):
            raise ModelError(
                f"session {session}: images of {_told(view)}, but the model learnt from {_told(learnt[0])}; bring them to "
                "one view (`remap` in session.yaml) and one features.image_scale, or describe the recordings' camera in "
                "synthesis.camera"
            )


def check_scale(scale: float, views: dict[str, dict]) -> None:
    """Raise ModelError unless the images of a dataset (views by session) were reduced as features.image_scale says."""
    for session, view in views.items():
        if view and _scale(view) != scale:
            raise ModelError(
                f"session {session}: its features are of images reduced by {_scale(view):g}, but features.image_scale is "
                f"{scale:g}; extract the features again and join them, or set features.image_scale: {_scale(view):g}"
            )


def _alike(view: dict, other: dict) -> bool:
    one, two = (v["camera"] or {} for v in (view, other))
    mirrored = one.get("mirrored") == two.get("mirrored") or not one or not two
    return _used(view) == _used(other) and mirrored and _scale(view) == _scale(other)


def _scale(view: dict) -> float:
    return view.get("image_scale", 1.0)


def _used(view: dict) -> list[int] | None:
    return view["crop_px"][2:] if view["crop_px"] else view["image_px"]


def _told(view: dict) -> str:
    camera = view["camera"] or {}
    mirrored = camera.get("mirrored")
    flipped = "" if mirrored is None else ", mirrored" if mirrored else ", not mirrored"
    smaller = f", reduced by features.image_scale {_scale(view):g}" if _scale(view) < 1 else ""
    return f"{' x '.join(map(str, _used(view) or '?'))} px{flipped}{smaller}"
