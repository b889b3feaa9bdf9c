"""A press as a differentiable function of PyTorch: what `gelforge.torch_press` is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch

from gelforge.config import ConfigError
from gelforge.differentiable import PLACE, press_slopes


class TorchForces(NamedTuple):
    """Forces of a press, float64 on the CPU, step by step: D steps, B bins, axes x, y, z of the sensor."""

    total_N: torch.Tensor  # (D, 3)
    bins_N: torch.Tensor  # (D, B, 3), k = nx iy + ix


class _Press(torch.autograd.Function):
    """Forces of the finite elements, with the derivatives that come with their solution."""

    @staticmethod
    def forward(ctx, described: dict, names: tuple[str, ...], *values: torch.Tensor):
        wanted = [name for name, needed in zip(names, ctx.needs_input_grad[2:]) if needed]
        amounts = {name: float(value) for name, value in zip(names, values)}
        place = [amounts.pop(name) for name in PLACE]
        found = press_slopes(*place, amounts, along=wanted, **described)
        ctx.names = names
        ctx.slopes = {name: (found.total_slope[name], found.bin_slope[name]) for name in wanted}
        ctx.like = [(value.dtype, value.device, value.shape) for value in values]
        return torch.from_numpy(found.total_force_N), torch.from_numpy(found.bin_force_N)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, along_total: torch.Tensor, along_bins: torch.Tensor):
        grads: list[torch.Tensor | None] = []
        for name, (dtype, device, shape) in zip(ctx.names, ctx.like):
            total, bins = ctx.slopes.get(name, (None, None))
            if total is None:
                grads.append(None)
                continue
            along = np.sum(along_total.numpy() * total) + np.sum(along_bins.numpy() * bins)
            grads.append(torch.as_tensor(along, dtype=dtype, device=device).reshape(shape))
        return None, None, *grads


def torch_press(
    x_mm: torch.Tensor | float,
    y_mm: torch.Tensor | float,
    depth_mm: torch.Tensor | float,
    effects: Mapping[str, torch.Tensor | float] | None = None,
    **described: Any,
) -> TorchForces:
    """Return the forces of a press as tensors whose gradients are the derivatives of the finite elements.

    Gradients flow to those of x_mm, y_mm [mm], depth_mm [mm] and the amounts of `effects` that are tensors with
    requires_grad; only for these derivatives are computed. They are first derivatives: a second one is refused by PyTorch. A
    call solves one press, in seconds; several presses are several calls.

    Parameters
    ----------
    x_mm, y_mm, depth_mm : tensor of one element, or float
        Position from the corner of the sensor's top surface, and depth from the first touch [mm].
    effects : mapping of str to tensor of one element, or float
        Amounts of effects, as in `gelforge.press_slopes`.
    **described
        `steps`, `sensor`, `indenter`, `materials`, `mechanics` and `study`, as in `gelforge.press_slopes`.

    Returns
    -------
    TorchForces
        Forces [N] in total (D, 3) and per bin (D, B, 3) at each step of the press; the last is that at depth_mm.

    Raises
    ------
    ConfigError
        As `gelforge.press_slopes`, and for tensors of more than one element.
    NotConverged
        As `gelforge.press_slopes`.

    Examples
    --------
    Which depth gives 0.3 N? Newton's method with the gradient:

    >>> import gelforge as gf, torch
    >>> gel = {"name": "gel", "thickness_mm": 4, "material": "gel"}
    >>> small = dict(
    ...     steps=2,
    ...     sensor={"width_x_mm": 16, "width_y_mm": 16, "wall_mm": 0, "layers": [gel], "bins": {"nx": 8, "ny": 8}},
    ...     materials={"gel": {"parameters": {"law": "neo_hooke", "mu_kPa": 20}}},
    ...     indenter={"kind": "sphere", "radius_mm": 4},
    ...     mechanics={"mesh": {"near_mm": 0.8, "near_radius_mm": 2, "far_mm": 2}},
    ... )
    >>> depth = torch.tensor(0.8, dtype=torch.float64, requires_grad=True)
    >>> for _ in range(3):
    ...     force = -gf.torch_press(8.0, 8.0, depth, **small).total_N[-1, 2]
    ...     (slope,) = torch.autograd.grad(force, depth)
    ...     depth = (depth - (force - 0.3) / slope).detach().requires_grad_()
    >>> bool(abs(-gf.torch_press(8.0, 8.0, depth, **small).total_N[-1, 2] - 0.3) < 1e-3)
    True
    """
    values = {"x_mm": x_mm, "y_mm": y_mm, "depth_mm": depth_mm, **(effects or {})}
    tensors = [
        torch.as_tensor(value, dtype=None if torch.is_tensor(value) else torch.float64)
        for value in values.values()
    ]
    for name, tensor in zip(values, tensors):
        if tensor.numel() != 1:
            raise ConfigError(
                f"{name}: a tensor of shape {tuple(tensor.shape)}; one number is needed, call once for each press"
            )
    return TorchForces(*_Press.apply(described, tuple(values), *tensors))
