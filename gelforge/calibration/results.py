"""What a calibration writes: calibration.json, readings.csv, a file per material, config.patch.yaml."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from gelforge.calibration.fit import Fit
from gelforge.calibration.parameters import MATERIAL_KINDS, Free
from gelforge.calibration.priors import NINETY
from gelforge.calibration.words import AT_PRIOR, at_bounds, correlation, kind_of, sentences
from gelforge.config import Study, write_yaml
from gelforge.files import digest, write_product_json
from gelforge.materials.fitting.law_file import MaterialLaw, write_law
from gelforge.mechanics.laws.law import PrincipalLaw
from gelforge.mechanics.laws.models import family_of, parameters_of
from gelforge.mismatch.pipeline.stage import differences
from gelforge.mismatch.result.verdict import PATCH, Provenance
from gelforge.mismatch.result.verdict_tables import READINGS, write_tables

FORMAT = "gelforge-calibration-1"
CALIBRATION = "calibration.json"
STEP = 1e-4  # of a logarithm: central differences then err by its square, 1e-8, and rounding by 1e-12
SHARED = "calibrated together with what else was free: errors that it shares with those are not in this file"
Materials = Mapping[str, MaterialLaw]


def write_results(
    out: Path, study: Study, fit: Fit, materials: Materials, title: str, synthetic: bool, made: Provenance
) -> dict[str, Any]:
    """Write all files but the page into a folder, and return the content of calibration.json."""
    out.mkdir(parents=True, exist_ok=True)
    content = content_of(fit, title, synthetic, made)
    content["tables"] = write_tables(out, {READINGS: readings_of(fit)})
    write_product_json(out / CALIBRATION, content)
    calibrated = calibrated_materials(fit, materials, title, synthetic, digest(content))
    for name, material in calibrated.items():
        write_law(out / f"{name}.json", material)
    write_yaml(out / PATCH, patch_of(study, fit, {name: out / f"{name}.json" for name in calibrated}))
    return content


def content_of(fit: Fit, title: str, synthetic: bool, made: Provenance) -> dict[str, Any]:
    """Return what calibration.json holds."""
    problem = fit.last.problem
    none, residuals = fit.start.left(np.zeros(len(fit.a))), fit.last.left(fit.a)
    return {
        "format": FORMAT,
        "title": title,
        "synthetic": synthetic,
        "sentences": sentences(fit),
        "parameters": [
            parameter_of(one, a, sd, at_bound)
            for one, a, sd, at_bound in zip(fit.free, fit.a, fit.sd, at_bounds(fit))
        ],
        "correlation": {
            "names": [one.name for one in fit.free],
            "matrix": correlation(fit.covariance).tolist(),
        },
        "error_N": {"before": rms(fit, none), "after": rms(fit, residuals)},
        "held_out": {
            "block": fit.block,
            "sites": len(set(problem.labels["site"][fit.held_out])),
            "of_sites": len(problem.observations.sites),
            "readings": int(fit.held_out.sum()),
            "force_N": rms(fit, problem.observations.flat(problem.observations.force), fit.held_out),
            "before_N": rms(fit, none, fit.held_out),
            "after_N": rms(fit, fit.last.left(fit.a_trained), fit.held_out),
        },
        "p": fit.p,
        "converged": fit.converged,
        "solved": fit.solved,
        "presses": int(problem.labels["press"].nunique()),
        "cannot_know": list(problem.observations.cannot_know),
        "provenance": made.model_dump(mode="json"),
    }


def parameter_of(one: Free, a: float, sd: float, at_bound: bool) -> dict[str, Any]:
    """Return an entry of calibration.json."""
    ends = np.clip([a - NINETY * sd, a + NINETY * sd], *one.bounds)
    return {
        "name": one.name,
        "unit": one.kind.unit,
        "words": one.kind.words,
        "study": one.start,
        "prior": {"mean": one.value(0.0), "interval_90": [one.prior.low, one.prior.high]}
        | {"source": one.prior.source},
        "value": one.value(a),
        "interval_90": [one.value(float(end)) for end in ends],
        "sd": sd,
        "sd_of": "logarithm" if one.kind.logarithmic else one.kind.unit,
        "posterior_over_prior": sd / one.width,
        "at_prior": bool(sd > AT_PRIOR * one.width),
        "at_bound": at_bound,
    }


def rms(fit: Fit, residual: np.ndarray, mask: np.ndarray | None = None) -> dict[str, float]:
    """Return the root mean square of entries (n,) [N] by axis, of those chosen (n,) bool."""
    table = pd.DataFrame({"axis": fit.last.problem.labels["axis"], "square": residual**2})
    means = (table if mask is None else table[mask]).groupby("axis")["square"].mean()
    return {"xyz"[int(axis)]: float(np.sqrt(square)) for axis, square in means.items()}


def readings_of(fit: Fit) -> pd.DataFrame:
    """Return the rows of readings.csv: before, after, and predicted without the readings held out."""
    problem = fit.last.problem
    labels, measured = problem.labels, problem.observations.flat(problem.observations.force)
    return labels[["session", "press", "x_mm", "y_mm", "depth_mm", "phase", "time_s"]].assign(
        site=labels["site"].astype(str),
        axis=np.array(list("xyz"))[labels["axis"]],
        measured_N=measured,
        base_N=measured - fit.start.left(np.zeros(len(fit.a))),
        after_N=measured - fit.last.left(fit.a),
        predicted_N=measured - fit.last.left(fit.a_trained),
        sigma_N=problem.covariance.standard_deviation,
        held_out=np.where(fit.held_out, fit.block, "no"),
    )


def calibrated_materials(
    fit: Fit, materials: Materials, title: str, synthetic: bool, inputs: str
) -> dict[str, MaterialLaw]:
    """Return the constitutive models with calibrated parameters, with the covariance of these."""
    names = list(dict.fromkeys(one.material for one in fit.free if one.material))
    calibrated = {}
    for name in names:
        rows = [k for k, one in enumerate(fit.free) if one.material == name]
        factors = [{kind_of(fit.free[k].name): fit.free[k].value(fit.a[k]) / fit.free[k].start} for k in rows]
        at = {kind: 1.0 for kind in MATERIAL_KINDS} | {key: v for one in factors for key, v in one.items()}
        law = scaled(materials[name].law, at)
        J = np.column_stack([_slope(materials[name].law, at, kind) for one in factors for kind in one])
        calibrated[name] = replace(
            MaterialLaw(name, law, inputs),
            covariance=J @ fit.covariance[np.ix_(rows, rows)] @ J.T,
            covariance_from=f"posterior of {', '.join(fit.free[k].name for k in rows)} by the presses of {title}",
            synthetic=synthetic,
            fitted_by="calibrated to presses (gelforge calibrate)",
            notes=(SHARED,) if len(fit.free) > len(rows) else (),
        )
    return calibrated


def scaled(law: PrincipalLaw, factors: Mapping[str, float]) -> PrincipalLaw:
    """Return a law with its moduli and its exponents times factors, the exponents at the same initial modulus."""
    law = law.with_exponents(factors["exponent"])
    family = family_of(law)
    moduli = [name.endswith("_kPa") for name in family.parameters]
    return family.law_of(parameters_of(law) * np.where(moduli, factors["modulus"], 1.0))


def _slope(law: PrincipalLaw, at: Mapping[str, float], kind: str) -> np.ndarray:
    """Return the derivatives (p,) of a law's parameters in the units of files by the logarithm of a factor."""
    ends = [parameters_of(scaled(law, {**at, kind: at[kind] * np.exp(step)})) for step in (STEP, -STEP)]
    return (ends[0] - ends[1]) / (2 * STEP)


def patch_of(study: Study, fit: Fit, files: Mapping[str, Path]) -> dict[str, Any]:
    """Return the keys with which the study is the calibrated one: files of materials, and values of the other parameters."""
    with_them = study
    for one, a in zip(fit.free, fit.a):
        if one.material is None:
            with_them = one.to_study(with_them, one.coordinate(one.start), float(a))
    changes = differences(study.model_dump(mode="json"), with_them.model_dump(mode="json"))
    if files:
        sources = dict.fromkeys(("tests", "mapping", "parameters"))
        changes["materials"] = {name: {**sources, "file": path.as_posix()} for name, path in files.items()}
    return changes


def summary(content: Mapping[str, Any]) -> Sequence[str]:
    """Return a calibration in lines of text.

    Parameters
    ----------
    content : mapping
        The calibration's file as read: parameters, held_out [N] and sentences.

    Returns
    -------
    sequence of str
        A line for each parameter and held-out force component, then the sentences.
    """
    lines = []
    for one in content["parameters"]:
        low, high = one["interval_90"]
        unit = "" if one["unit"] == "1" else f" {one['unit']}"
        prior = one["prior"]["mean"]
        lines.append(
            f"{one['name']}: {one['value']:.4g}{unit} (90 % interval {low:.4g} to {high:.4g}; before {prior:.4g})"
        )
    held = content["held_out"]
    for axis, before in held["before_N"].items():
        lines.append(f"F{axis} held out, off by: {before:.3g} N before, {held['after_N'][axis]:.3g} N after")
    return [*lines, *content["sentences"]]
