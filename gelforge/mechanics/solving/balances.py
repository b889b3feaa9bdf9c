"""Balances that a converged state must satisfy: forces and moments of contact and base."""

from __future__ import annotations

import numpy as np

from gelforge.mechanics.contact.state import State
from gelforge.mechanics.meshes.mesh import Mesh


def force_balance(state: State, least_force: float = 0.0) -> float:
    """Return |contact force + reaction| / |contact force|; the reaction comes from internal forces.

    Parameters
    ----------
    state : State
        A converged state.
    least_force : float
        What a smaller contact force is taken for [N].

    Returns
    -------
    float
        0 in balance [-].
    """
    size = max(float(np.linalg.norm(state.force)), least_force)
    return float(np.linalg.norm(state.force + state.reaction)) / size


def moment_balance(
    mesh: Mesh, state: State, length: float, deformed: bool = True, least_force: float = 0.0
) -> float:
    """Return |moment of contact and base forces| / (|contact force| length), about the indenter's centre.

    Parameters
    ----------
    mesh : Mesh
        Of the body.
    state : State
        A converged state.
    length : float
        That makes it a number [mm].
    deformed : bool
        Whether contact forces act at the deformed nodes; at small strain they act at the undeformed ones.
    least_force : float
        What a smaller contact force is taken for [N].

    Returns
    -------
    float
        0 in balance [-].
    """
    surface = mesh.X[mesh.surface.nodes] + (state.u[mesh.surface.nodes] if deformed else 0.0)
    contact = np.cross(surface - state.centre[:3], state.normal_force + state.friction_force).sum(axis=0)
    base = np.cross(mesh.X[mesh.fixed] - state.centre[:3], state.fixed_force).sum(axis=0)
    size = max(float(np.linalg.norm(state.force)), least_force)
    return float(np.linalg.norm(contact + base)) / (size * length)
