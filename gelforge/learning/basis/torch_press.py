"""An indentation whose derivatives are known, as a differentiable function of PyTorch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from gelforge.config import ConfigError


class TorchForces(NamedTuple):
    """Forces of an indentation, float64 on the CPU, step by step: D steps, B bins, axes x, y, z of the sensor."""

    total_N: Tensor  # (D, 3)
    bins_N: Tensor  # (D, B, 3), k = nx iy + ix

    def __repr__(self) -> str:
        last = ", ".join(f"{value:.4g}" for value in self.total_N[-1].tolist())
        shapes = f"total_N {tuple(self.total_N.shape)}, bins_N {tuple(self.bins_N.shape)}"
        return f"TorchForces: ({last}) N in total at the last step; {shapes}"


class _Press(torch.autograd.Function):
    """Forces of a solver, with the derivatives that come with its solution."""

    @staticmethod
    def forward(ctx, solved: Callable, names: tuple[str, ...], *values: Tensor):
        wanted = [name for name, needed in zip(names, ctx.needs_input_grad[2:]) if needed]
        solution = solved({name: float(value) for name, value in zip(names, values)}, wanted)
        ctx.names = names
        ctx.slopes = {name: (solution.total_slope[name], solution.bin_slope[name]) for name in wanted}
        ctx.like = [(value.dtype, value.device, value.shape) for value in values]
        return torch.from_numpy(solution.total_force_N), torch.from_numpy(solution.bin_force_N)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, along_total: Tensor, along_bins: Tensor):
        grads: list[Tensor | None] = []
        for name, (dtype, device, shape) in zip(ctx.names, ctx.like):
            total, bins = ctx.slopes.get(name, (None, None))
            if total is None:
                grads.append(None)
                continue
            along = np.sum(along_total.numpy() * total) + np.sum(along_bins.numpy() * bins)
            grads.append(torch.as_tensor(along, dtype=dtype, device=device).reshape(shape))
        return None, None, *grads


def forces_as_tensors(solved: Callable, values: Mapping[str, Tensor | float]) -> TorchForces:
    """Return the forces of an indentation as tensors whose gradients are the derivatives that come with its solution.

    Parameters
    ----------
    solved : callable
        Takes numbers by name and the names along which derivatives are wanted. Returns total_force_N (D, 3) and bin_force_N
        (D, B, 3), and by name total_slope and bin_slope of the same shapes [N per unit].
    values : mapping of str to tensor of one element, or float
        By name.

    Returns
    -------
    TorchForces
        float64 on the CPU [N].

    Raises
    ------
    ConfigError
        For tensors of more than one element, and values that are no numbers.
    """
    try:
        known = ((value, None if torch.is_tensor(value) else torch.float64) for value in values.values())
        tensors = [torch.as_tensor(value, dtype=dtype) for value, dtype in known]
    except (TypeError, ValueError):
        raise ConfigError(f"{', '.join(values)}: tensors of one element or numbers are needed") from None
    for name, tensor in zip(values, tensors):
        if tensor.numel() != 1:
            raise ConfigError(
                f"{name}: a tensor of shape {tuple(tensor.shape)}; one number is needed, call once for each indentation"
            )
    return TorchForces(*_Press.apply(solved, tuple(values), *tensors))
