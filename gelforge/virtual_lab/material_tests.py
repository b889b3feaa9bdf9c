"""Synthetic raw material tests of materials whose true law is known, with sample scatter and reading noise.

The files have the form of a laboratory's: forces, pressures, apex radii and tracked stretches, one CSV per
sample. Test pieces are those of Sferrazza et al. 2019, sec. II-A. Every file says in its first line that it
is synthetic.
"""

from __future__ import annotations

import zlib
from pathlib import Path

import numpy as np
import pandas as pd

from gelforge.config import VirtualLab, VirtualSample
from gelforge.files import write_text
from gelforge.mechanics.laws.homogeneous import LOAD_CASES, cauchy_stress, principal_stretches
from gelforge.mechanics.laws.models.ogden import Ogden

# Test pieces, strain rate and largest strains of Sferrazza et al. 2019, sec. II-A. Materials that it does not have end at 1.
# length, width
GAUGE_MM = {"uniaxial": (40.0, 10.0), "pure_shear": (10.0, 60.0), "equibiaxial": (30.0, 30.0)}
THICKNESS_MM, STRAIN_RATE_PER_S = 0.5, 0.003
THICKNESS_SCATTER = 0.04  # of cast sheets; the thickness of each sample is measured, so it costs no accuracy
# Of a test: a strain of 0.025 or less from one to the next. Largest strain 2 over 80 rows (Sferrazza et al. 2019, sec.
# II-A).
ROWS = 80
TRACKING_NOISE = 0.002  # of the lateral stretch


def make_material_tests(lab: VirtualLab, folder: str | Path) -> None:
    """Write <folder>/<material>/samples.csv and one CSV per sample for each material of a virtual lab.

    The same lab gives the same bytes; a material's files do not depend on the other materials.

    Parameters
    ----------
    lab : VirtualLab
        Its materials, and how they are tested.
    folder : str or Path
        Receives a folder for each material.
    """
    for material, parameters in lab.materials.items():
        law = parameters.constitutive_model()
        # nominal strain at the end of a test
        largest = 1 + {"ecoflex_gel": 2.0, "elastosil_25_1": 1.0}.get(material, 1.0)
        samples = []
        for test in LOAD_CASES:
            for number in range(1, lab.material_tests.samples + 1):
                seed = [lab.material_tests.seed, zlib.crc32(f"{material}/{test}".encode()), number]
                row, readings = _sample(
                    law, test, number, largest, lab.material_tests, np.random.default_rng(seed)
                )
                samples.append(row)
                _write(Path(folder) / material / row["file"], readings, lab, material)
        _write(Path(folder) / material / "samples.csv", pd.DataFrame(samples), lab, material)


def _sample(
    law: Ogden, test: str, number: int, largest: float, scatter: VirtualSample, rng: np.random.Generator
):
    """Return the row of samples.csv and the readings of one sample."""
    stiffness = np.exp(scatter.stiffness_scatter * rng.standard_normal())
    h0 = THICKNESS_MM * np.exp(THICKNESS_SCATTER * rng.standard_normal())
    length, width = GAUGE_MM[test]
    if test == "equibiaxial":
        readings = _inflate(law, stiffness, h0, width, largest, scatter.noise, rng)
    else:
        readings = _pull(law, stiffness, test, h0 * width, largest, scatter.noise, rng)
    row = {
        "file": f"{test}_{number:02d}.csv",
        "test": test,
        "sample": f"s{number:02d}",
        "width_mm": width,
        "gauge_length_mm": length,
        "thickness_mm": round(h0, 4),
        "strain_rate_per_s": STRAIN_RATE_PER_S,
        "age_days": 0,
        "temperature_C": 23,
        "cycle": 1,
    }
    return row, readings


def _pull(law, stiffness, test, area_mm2, largest, noise, rng) -> pd.DataFrame:
    """Return time, force and tracked stretches of a uniaxial or pure-shear sample."""
    stretch = np.linspace(1.0, largest, ROWS).round(4)
    force = stiffness * cauchy_stress(law, test, stretch) / stretch * area_mm2
    lateral = principal_stretches(test, stretch)[:, 1]
    return pd.DataFrame(
        {
            "time_s": ((stretch - 1) / STRAIN_RATE_PER_S).round(2),
            "force_N": (force + noise * force.max() * rng.standard_normal(ROWS)).round(6),
            "stretch_1": stretch,
            "stretch_2": (lateral + TRACKING_NOISE * rng.standard_normal(ROWS)).round(4),
        }
    )


def _inflate(law, stiffness, h0, diameter_mm, largest, noise, rng) -> pd.DataFrame:
    """Return time, pressure, apex radius and tracked stretches of an inflated membrane.

    The membrane is taken as a spherical cap on its clamp whose apex stretch is arc over diameter, lam = theta
    / sin(theta) with r = diameter / (2 sin theta): a plausible radius; the stress depends on p r only.
    """
    stretch = np.linspace(1.01, largest, ROWS).round(4)  # a flat membrane has no radius
    theta = np.interp(stretch, *_cap_angles(largest))
    radius = diameter_mm / (2 * np.sin(theta))
    # kPa
    pressure = 2 * h0 * stretch**-2 * stiffness * cauchy_stress(law, "equibiaxial", stretch) / radius * 1e3
    return pd.DataFrame(
        {
            "time_s": ((stretch - 1) / STRAIN_RATE_PER_S).round(2),
            "pressure_kPa": (pressure + noise * pressure.max() * rng.standard_normal(ROWS)).round(6),
            "apex_radius_mm": (radius * (1 + noise * rng.standard_normal(ROWS))).round(3),
            "stretch_1": stretch,
            "stretch_2": (stretch + TRACKING_NOISE * rng.standard_normal(ROWS)).round(4),
        }
    )


def _cap_angles(largest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return stretches theta / sin(theta) and their angles theta [rad], up to the largest stretch."""
    theta = np.linspace(1e-3, np.pi - 0.05, 4000)
    stretch = theta / np.sin(theta)
    if stretch[-1] < largest:
        raise ValueError(
            f"a cap reaches a stretch of {stretch[-1]:.3g}, not {largest:g}; lower the largest strain"
        )
    return stretch, theta


def _write(path: Path, table: pd.DataFrame, lab: VirtualLab, material: str) -> None:
    seed = lab.material_tests.seed
    title = (
        f"# synthetic, not measured: {material}, made by gelforge's virtual lab {lab.serial}, seed {seed}\n"
    )
    write_text(path, title + table.to_csv(index=False, lineterminator="\n"))
