"""Flow that stress speeds up (Eyring 1936, doi:10.1063/1.1749836): a spring, and a dashpot with the sinh of its stress.

Foams and filled gels load along a bent curve, relax with the logarithm of time, and unload as stiffly as they began to
load: a linear element that softens the loading so much would relax as fast when it is held.
"""

from __future__ import annotations

import numpy as np

LONGEST_STEP = 0.1  # flow strains: Strang's splitting errs by less than 1e-3 of the stress


def flow(
    time_s: np.ndarray, strain: np.ndarray, started_s: float, flow_strain: np.ndarray, rate_per_s: np.ndarray
) -> np.ndarray:
    r"""Return the stress (m, k) along a path (m,) of k elements that were at rest when it began, in their flow stress.

    .. math:: \dot y = \dot\epsilon / \epsilon_f - r \sinh y

    flow_strain, rate_per_s (k,): :math:`\epsilon_f` and r. Strain and flow take turns (half a step of strain, the flow's
    exact solution, half a step of strain), where strain is linear between rows.
    """
    stress, state = np.empty((len(time_s), len(flow_strain))), np.zeros(len(flow_strain))
    last_t, last_e = started_s, 0.0
    for row, (t, e) in enumerate(zip(time_s, strain)):
        steps = max(1, int(np.ceil(abs(e - last_e) / (LONGEST_STEP * flow_strain.min()))))
        half, dt = (e - last_e) / flow_strain / steps / 2, max(t - last_t, 0.0) / steps
        for _ in range(steps):
            state = _relaxed(state + half, rate_per_s * dt) + half
        stress[row], last_t, last_e = state, t, e
    return stress


def _relaxed(y: np.ndarray, passed: np.ndarray) -> np.ndarray:
    r"""Return the solution of :math:`\dot y = -\sinh y` after some time: :math:`-\ln\tanh(|y| / 2)` grows at rate 1."""
    return np.sign(y) * _minus_log_tanh_half(_minus_log_tanh_half(np.abs(y)) + passed)


def _minus_log_tanh_half(x: np.ndarray) -> np.ndarray:
    """Return -ln tanh(x / 2) of x >= 0, which is its own inverse."""
    return np.log1p(2.0 / np.expm1(np.clip(x, 1e-300, 700.0)))
