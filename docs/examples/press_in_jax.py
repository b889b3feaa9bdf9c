"""An indentation as one primitive of JAX with a gradient; `jit` and `grad` go through it."""

import jax
import jax.numpy as jnp
import numpy as np

import gelforge as gf

jax.config.update("jax_enable_x64", True)
NAMES = ("x_mm", "y_mm", "depth_mm")


def solved(values):  # (3,) -> total force (3,) [N] at the depth, and its Jacobian (3, 3) [N/mm]
    found = gf.press_slopes(*map(float, values), steps=2)
    return found.total_force_N[-1], np.stack([found.total_slope[name][-1] for name in NAMES], axis=1)


SHAPES = jax.ShapeDtypeStruct((3,), np.float64), jax.ShapeDtypeStruct((3, 3), np.float64)


@jax.custom_vjp
def press(values):
    return jax.pure_callback(solved, SHAPES, values)[0]


press.defvjp(lambda values: jax.pure_callback(solved, SHAPES, values), lambda slope, force: (force @ slope,))
gradient = jax.grad(lambda values: press(values)[2])(jnp.array([16.0, 16.0, 0.5]))  # d Fz / d (x, y, depth)
