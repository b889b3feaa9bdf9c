r"""Solutions from outside that judge the finite elements: Hertz, the bonded layer, homogeneous stresses.

This module imports nothing of the package, so that no mistake of ours can enter it.

Contact is frictionless and of small strain; the rigid indenter is the paraboloid z = r^2 / (2 R), to which a ball of
radius R comes down for a contact radius a much smaller than R (their profiles differ by r^4 / (8 R^3)).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ellipe, ellipkm1

# Quadrature of the integral equation: the kernel is smooth, so both converge geometrically. As measured, 40 points suffice
# for 12 digits up to a/h = 4; the transform's integrand falls as u^2 exp(-2 u) and is below 1e-17 at u = 25.
LAYER_POINTS, TRANSFORM_POINTS, TRANSFORM_END = 64, 400, 25.0


# ------------------------------------------------------------------------------------------------ elastic constants
def poissons_ratio(bulk_to_shear: float) -> float:
    """Return Poisson's ratio nu = (3 K - 2 mu) / (2 (3 K + mu)).

    Parameters
    ----------
    bulk_to_shear : float
        K/mu.

    Returns
    -------
    float
        Below 1/2.

    Examples
    --------
    >>> round(poissons_ratio(1000.0), 4)
    0.4995
    """
    return (3 * bulk_to_shear - 2) / (2 * (3 * bulk_to_shear + 1))


def contact_modulus(shear_modulus: float, nu: float) -> float:
    """Return the contact modulus E* = E / (1 - nu^2) = 2 mu / (1 - nu) of a rigid indenter.

    Parameters
    ----------
    shear_modulus : float
        mu [MPa].
    nu : float
        Poisson's ratio.

    Returns
    -------
    float
        [MPa].
    """
    return 2 * shear_modulus / (1 - nu)


# ------------------------------------------------------------------------------------------------------------- Hertz
@dataclass(frozen=True)
class PressedSurface:
    """A rigid paraboloid pressed into an elastic surface."""

    depth: float  # mm
    force: float  # N
    contact_radius: float  # mm


def hertz(depth: float, radius: float, modulus: float) -> PressedSurface:
    """Return a ball pressed into a half space: F = 4/3 E* sqrt(R) depth^(3/2), a = sqrt(R depth) (Hertz 1882; Johnson
    1985, 4.2).

    Parameters
    ----------
    depth : float
        [mm].
    radius : float
        R [mm].
    modulus : float
        E* [MPa].

    Returns
    -------
    PressedSurface
        Depth [mm], force [N] and contact radius [mm].
    """
    force = 4 / 3 * modulus * np.sqrt(radius) * depth**1.5
    return PressedSurface(depth, force, float(np.sqrt(radius * depth)))


# ------------------------------------------------------------------------------------------------------ bonded layer
def layer_compliance(u: np.ndarray, nu: float) -> np.ndarray:
    r"""Return L(u), u = xi h: the surface compliance of a layer bonded to a rigid base over that of the half space.

    A surface pressure of Hankel transform p(xi) moves the surface by (1 - nu) L / (mu xi) p,

    .. math:: L = \frac{2 \kappa \sinh 2u - 4u}{2 \kappa \cosh 2u + 1 + \kappa^2 + 4 u^2}, \quad \kappa = 3 - 4 \nu

    (Vorovich, Aleksandrov & Babeshko 1974; Gladwell 1980, ch. 5).
    """
    kappa = 3 - 4 * nu
    u = np.asarray(u, dtype=float)
    # times exp(-2u), so that it does not overflow
    decay = np.exp(-2 * u)
    above = kappa * (1 - decay**2) - 4 * u * decay
    below = kappa * (1 + decay**2) + (1 + kappa**2 + 4 * u**2) * decay
    return above / below


def bonded_layer_at_radius(
    contact_radius: float, radius: float, thickness: float, shear_modulus: float, nu: float
) -> PressedSurface:
    r"""Return the indentation of a layer bonded to a rigid base whose contact radius a is given.

    With p(xi) = \int_0^a phi(t) cos(xi t) dt the pressure vanishes outside a, and the contact condition
    w = depth - r^2 / (2 R) becomes the Fredholm equation of the second kind (Sneddon 1966, ch. 4; Gladwell 1980)

    .. math::
        \phi(t) - \frac{2}{\pi} \int_0^a \phi(s) \int_0^\infty (1 - L(\xi h)) \cos \xi t \cos \xi s \, d\xi \, ds
        = \frac{2 \mu}{\pi (1 - \nu)} \left( \mathrm{depth} - \frac{t^2}{R} \right), \qquad F = 2 \pi \int_0^a \phi \, dt .

    A smooth edge asks for phi(a) = 0, which fixes the depth.

    Parameters
    ----------
    contact_radius : float
        a [mm].
    radius : float
        R of the ball [mm].
    thickness : float
        h of the layer [mm].
    shear_modulus : float
        mu [MPa].
    nu : float
        Poisson's ratio.

    Returns
    -------
    PressedSurface
        Depth [mm], force [N] and contact radius [mm].
    """
    t, weight = _gauss(0.0, contact_radius, LAYER_POINTS)
    u, transform_weight = _gauss(0.0, TRANSFORM_END, TRANSFORM_POINTS)
    # The last row and column are the edge t = a, where no quadrature point lies.
    points = np.append(t, contact_radius)
    cosine = np.cos(np.outer(points, u / thickness))
    lost = transform_weight / thickness * (1 - layer_compliance(u, nu))
    kernel = 2 / np.pi * (cosine * lost) @ cosine[:-1].T
    system = np.eye(len(t)) - kernel[:-1] * weight
    scale = 2 * shear_modulus / (np.pi * (1 - nu))
    unit, curved = np.linalg.solve(system, scale * np.stack([np.ones_like(t), t**2 / radius], axis=1)).T
    # phi at the edge, by the equation itself, of a unit depth and of the profile
    edge_unit = scale + kernel[-1] @ (weight * unit)
    edge_curved = scale * contact_radius**2 / radius + kernel[-1] @ (weight * curved)
    depth = edge_curved / edge_unit
    force = 2 * np.pi * weight @ (depth * unit - curved)
    return PressedSurface(float(depth), float(force), contact_radius)


def _gauss(start: float, stop: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points and weights of Gauss-Legendre quadrature on an interval."""
    x, w = np.polynomial.legendre.leggauss(count)
    return start + (stop - start) * (x + 1) / 2, (stop - start) / 2 * w


# ----------------------------------------------------------------------------------- stick and slip under a normal load
@dataclass(frozen=True)
class PressedWithFriction:
    """A rigid indenter pressed straight into a half space with friction: inside the stick radius nothing slips."""

    stick_ratio: float  # stick radius over contact radius
    friction_share: float  # sum of the radial friction over the normal force
    # Normal force over that of the frictionless press to the same depth, of a flat indenter
    stiffening: float


def pressed_with_friction(friction: float, nu: float, rings: int = 200) -> PressedWithFriction:
    r"""Return the indentation of a flat indenter of radius 1 on a half space with Coulomb friction (Spence 1968, 1975).

    Pressure p and outward friction q move the surface (indenter's radius and shear modulus 1) by

    .. math::
        w(r) = (1 - \nu) \int_0^1 p(t) t K_0 dt - \frac{1 - 2 \nu}{2} \int_r^1 q(t) dt, \qquad
        u(r) = (1 - \nu) \int_0^1 q(t) t K_1 dt - \frac{1 - 2 \nu}{2 r} \int_0^r p(t) t dt, \qquad
        K_n(r, t) = \int_0^\infty J_n(s r) J_n(s t) ds .

    Under the indenter w = 1; where it sticks u = 0, and nearer to the edge q = friction p. The stick zone is the largest in
    which q stays below friction p. The tractions are even over rings, narrow near the edge where they are singular; with
    unlimited friction the force is Mossakovskii's, ln(3 - 4 nu) / (1 - 2 nu) in place of 1 / (1 - nu) (a test holds it).
    By Spence's theorem of self-similarity stick ratio and friction share are the same for a ball that is pressed in:
    its tractions are a sum of those of flat indenters of growing radius, whose stick zones are in proportion.

    Parameters
    ----------
    friction : float
        Coulomb's coefficient [-].
    nu : float
        Poisson's ratio.
    rings : int
        Over which the tractions are even.

    Returns
    -------
    PressedWithFriction
        Stick ratio, friction share and stiffening, all [-].
    """
    edges = np.sin(np.linspace(0, np.pi / 2, rings + 1))
    r = (edges[1:] + edges[:-1]) / 2
    pressing, rubbing = (_ring_moves(edges, r, kernel) for kernel in (_kernel_0, _kernel_1))
    # The length of a ring that lies beyond r
    beyond = np.maximum(edges[1:] - np.maximum(edges[:-1], r[:, None]), 0)
    within = np.maximum(np.minimum(edges[1:], r[:, None]) ** 2 - edges[:-1] ** 2, 0) / (2 * r[:, None])
    direct, cross = 1 - nu, (1 - 2 * nu) / 2
    down = np.hstack([direct * pressing, -cross * beyond])
    outward = np.hstack([-cross * within, direct * rubbing])
    sliding = np.hstack([-friction * np.eye(rings), np.eye(rings)])

    def tractions(sticking: int) -> tuple[np.ndarray, np.ndarray]:
        system = np.vstack([down, outward[:sticking], sliding[sticking:]])
        solution = np.linalg.solve(system, np.repeat([1.0, 0.0], rings))
        return solution[:rings], solution[rings:]

    low, high = 1, rings  # low rings stick, high do not all
    while high - low > 1:
        middle = (low + high) // 2
        p, q = tractions(middle)
        low, high = (middle, high) if q[middle - 1] <= friction * p[middle - 1] else (low, middle)
    p, q = tractions(low)
    area = np.pi * np.diff(edges**2)
    force = area @ p
    return PressedWithFriction(float(edges[low]), float(area @ q / force), float(force * direct / 4))


def _ring_moves(edges: np.ndarray, r: np.ndarray, kernel: Callable) -> np.ndarray:
    """Return \\int kernel(r_i, t) t dt over each ring j (n, n); the kernel is singular as log |r - t|."""
    x, weight = _gauss(0.0, 1.0, 16)
    wide = np.diff(edges)
    t = edges[:-1, None] + wide[:, None] * x  # (n, 16)
    moves = np.einsum("ijk,jk->ij", kernel(r[:, None, None], t) * t, wide[:, None] * weight)
    half = wide[:, None] / 2 * x**3  # both sides of the middle: the cube takes the logarithm's place
    for side in (-1, 1):
        t = r[:, None] + side * half
        part = (kernel(r[:, None], t) * t) @ (3 * x**2 * weight) * wide / 2
        np.fill_diagonal(moves, part + (moves.diagonal() if side == 1 else 0))
    return moves


def _kernel_0(r: np.ndarray, t: np.ndarray) -> np.ndarray:
    return 2 / (np.pi * (r + t)) * ellipkm1(((r - t) / (r + t)) ** 2)


def _kernel_1(r: np.ndarray, t: np.ndarray) -> np.ndarray:
    rest = ((r - t) / (r + t)) ** 2  # 1 - m
    numerator = (r**2 + t**2) * ellipkm1(rest) - (r + t) ** 2 * ellipe(1 - rest)
    return numerator / (np.pi * r * t * (r + t))


# ----------------------------------------------------------------------------------------------- homogeneous stresses
def ogden_uniaxial(lam: float, mu: tuple[float, ...], alpha: tuple[float, ...]) -> float:
    """Return the nominal stress of an incompressible bar, sum mu (lam^(alpha-1) - lam^(-alpha/2-1)) (Ogden 1972).

    Parameters
    ----------
    lam : float
        Stretch [-].
    mu : tuple of float
        [MPa].
    alpha : tuple of float
        [-], as many as mu.

    Returns
    -------
    float
        [MPa].
    """
    return sum(m * (lam ** (a - 1) - lam ** (-a / 2 - 1)) for m, a in zip(mu, alpha))


# --------------------------------------------------------------------------------------------- tangential loading
@dataclass(frozen=True)
class PartialSlip:
    """A rigid ball that is pressed on an elastic half space and then moved sideways, before all of it slides."""

    force: float  # N, sideways
    stick_radius: float  # mm


def sliding_shift(
    normal_force: float, contact_radius: float, friction: float, shear_modulus: float, nu: float
) -> float:
    """Return the shift 3 mu P (2 - nu) / (16 G a) at which all of a ball's contact slides (Johnson 1985, eq. 7.42b).

    Parameters
    ----------
    normal_force : float
        P [N].
    contact_radius : float
        a [mm].
    friction : float
        Coulomb's coefficient mu [-].
    shear_modulus : float
        G [MPa].
    nu : float
        Poisson's ratio.

    Returns
    -------
    float
        [mm].
    """
    return 3 * friction * normal_force * (2 - nu) / (16 * shear_modulus * contact_radius)


def cattaneo_mindlin(
    shift: float, normal_force: float, contact_radius: float, friction: float, shear_modulus: float, nu: float
) -> PartialSlip:
    """Return the sideways force and the stick radius after a shift at a constant normal force P.

    shift = 3 mu P (2 - nu) / (16 G a) (1 - (1 - Q / mu P)^(2/3)) and c = a (1 - Q / mu P)^(1/3) (Cattaneo 1938;
    Mindlin 1949; Johnson 1985, eqs. 7.42). The normal pressure is taken not to feel the shear, which is exact at nu = 1/2,
    and the slip to point along the shift, which is not: its part across it, of some nu / (4 - 2 nu), is left out.

    Parameters
    ----------
    shift : float
        Of the ball, sideways [mm].
    normal_force : float
        P [N].
    contact_radius : float
        a [mm].
    friction : float
        Coulomb's coefficient mu [-].
    shear_modulus : float
        G [MPa].
    nu : float
        Poisson's ratio.

    Returns
    -------
    PartialSlip
        Sideways force Q [N] and stick radius c [mm]; c = 0 once all slides.
    """
    sliding = sliding_shift(normal_force, contact_radius, friction, shear_modulus, nu)
    left = max(1 - shift / sliding, 0.0) ** 1.5  # 1 - Q / mu P
    return PartialSlip(friction * normal_force * (1 - left), contact_radius * left ** (1 / 3))


def cattaneo_mindlin_traction(
    r: np.ndarray, contact_radius: float, stick_radius: float, normal_force: float, friction: float
) -> np.ndarray:
    """Return the shear traction of partial slip, mu p_0 (sqrt(1 - r^2/a^2) - c/a sqrt(1 - r^2/c^2)).

    Parameters
    ----------
    r : numpy.ndarray
        Distances (...) from the middle of the contact [mm].
    contact_radius, stick_radius : float
        a and c [mm].
    normal_force : float
        [N].
    friction : float
        Coulomb's coefficient mu [-].

    Returns
    -------
    numpy.ndarray
        (...) [MPa].
    """
    a, c, r = contact_radius, stick_radius, np.asarray(r, dtype=float)
    largest = friction * 3 * normal_force / (2 * np.pi * a**2)
    inner = np.sqrt(np.maximum(1 - r**2 / c**2, 0.0)) if c > 0 else 0.0
    return largest * (np.sqrt(np.maximum(1 - r**2 / a**2, 0.0)) - c / a * inner)
