"""The solver of inverse elasticity in PyTorch, its iterations written out, for export."""

from __future__ import annotations

import numpy as np
import torch
from torch import nn

from gelforge.learning.elasticity.inverse import ITERATIONS, RELAXATION, SPARSITY, Inverse


class Unrolled(nn.Module):
    """The forces (n, 3 B) of `Inverse.inputs` from flow (n, 2 r^2) [px], as `Inverse.solve` finds them from nothing."""

    left: torch.Tensor
    singular: torch.Tensor
    right: torch.Tensor
    taken: torch.Tensor
    unit: torch.Tensor

    def __init__(self, inverse: Inverse):
        super().__init__()
        penalty, ridge, taken = inverse.step
        self.penalty, self.ridge, self.friction = float(penalty), float(ridge), inverse.friction
        unit = np.tile(inverse.unit_N, len(inverse.right) // 3)
        keep = {"left": inverse.left, "singular": inverse.singular, "right": inverse.right}
        for name, values in (keep | {"taken": taken, "unit": unit}).items():
            self.register_buffer(name, torch.from_numpy(values.copy()))

    def forward(self, flow: torch.Tensor) -> torch.Tensor:
        given = ((flow @ self.left) * self.singular) @ self.right.T
        parts = given.unflatten(1, (-1, 3))
        pressure = parts[..., 2:]
        largest = torch.clamp(-pressure, min=0).amax(dim=1, keepdim=True)
        given = torch.cat([parts[..., :2], pressure + SPARSITY * largest], dim=-1).flatten(1)
        force = multiplier = torch.zeros_like(given)
        for _ in range(ITERATIONS):
            pulled = given + self.penalty * (force - multiplier)
            free = (pulled - (pulled @ self.taken) @ self.right.T) / self.ridge
            ahead = RELAXATION * free + (1 - RELAXATION) * force + multiplier
            force = self._in_cone(ahead)
            multiplier = ahead - force
        return force / self.unit

    def _in_cone(self, force: torch.Tensor) -> torch.Tensor:
        mu, parts = self.friction, force.unflatten(1, (-1, 3))
        push = -parts[..., 2:]
        slide = torch.sqrt((parts[..., :2] ** 2).sum(dim=-1, keepdim=True))
        inside = slide <= mu * push
        along = torch.clamp((push + mu * slide) / (1 + mu**2), min=0)
        scale = torch.where(inside, torch.ones_like(slide), mu * along / torch.clamp(slide, min=1e-30))
        return torch.cat([parts[..., :2] * scale, -torch.where(inside, push, along)], dim=-1).flatten(1)
