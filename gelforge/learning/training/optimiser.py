"""A network's optimiser and step size: Muon for the kernels of convolutions, AdamW for other weights; the article's Adam."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import torch
from torch import nn

from gelforge.config.parts.learning import CompleteLearning
from gelforge.learning.networks import network_of

# Errors and minutes of networks trained so: `python benchmarks/networks.py`:
WARM_UP = 0.15  # share of the steps in which the step size grows
LAST_RATE = 1e-3  # of the largest step size, at the end
WEIGHT_DECAY = 1e-4
# Step size of Muon, over that of AdamW. Measured: of 8, 3 and 1.5 it has the smallest error on held-out simulated rows.
MUON_RATE = 1.5


class Optimiser:
    """What changes a network's weights.

    Muon (Jordan 2024, in PyTorch) replaces the momentum of a matrix by the nearest one with orthogonal rows. The kernel of a
    convolution (out, in, 3, 3) is a matrix (out, 9 in).
    """

    def __init__(self, network: nn.Module, learning: CompleteLearning):
        self.learning = learning
        self._kernels: list[tuple[torch.Tensor, nn.Parameter]] = []
        self._parts: list[torch.optim.Optimizer]
        weights, rate = list(network.parameters()), learning.learning_rate
        if network_of(learning.network).as_article:
            self._parts = [torch.optim.Adam(weights, lr=rate)]
            return
        kernels = [layer.weight for layer in network.modules() if isinstance(layer, nn.Conv2d)]
        self._kernels = [(w, nn.Parameter(_matrix(w.detach()))) for w in kernels if w.shape[-1] > 1]
        if any(w.data_ptr() != matrix.data_ptr() for w, matrix in self._kernels):
            raise ValueError(
                "kernels are copied to matrices and would not be trained; let channels come last in memory"
            )
        taken = {id(kernel) for kernel, _ in self._kernels}
        others = [w for w in weights if id(w) not in taken]
        self._parts = [torch.optim.AdamW(others, lr=rate, weight_decay=WEIGHT_DECAY, fused=True)]
        if self._kernels:
            muon = partial(torch.optim.Muon, weight_decay=WEIGHT_DECAY, adjust_lr_fn="match_rms_adamw")
            self._parts.append(muon([matrix for _, matrix in self._kernels], lr=rate))

    def step(self, loss: torch.Tensor, done: int) -> None:
        """Change the weights against the gradient of a loss, after `done` steps."""
        for part in self._parts:
            part.zero_grad(set_to_none=True)
        for kernel, _ in self._kernels:
            kernel.grad = None
        loss.backward()
        for kernel, matrix in self._kernels:
            assert kernel.grad is not None
            matrix.grad = _matrix(kernel.grad)
        for number, part in enumerate(self._parts):
            for group in part.param_groups:
                group["lr"] = (MUON_RATE if number else 1.0) * rate(self.learning, done)
            part.step()

    def state_dict(self) -> dict[str, Any]:
        return {str(number): part.state_dict() for number, part in enumerate(self._parts)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        for number, part in enumerate(self._parts):
            part.load_state_dict(state[str(number)])


def _matrix(kernel: torch.Tensor) -> torch.Tensor:
    """Return a kernel (out, in, y, x) as a matrix (out, y x in), the same memory where channels come last."""
    return kernel.movedim(1, -1).flatten(1)


def rate(learning: CompleteLearning, step: int) -> float:
    """Return the step size: steady for the article's network, else up along a line and down along a cosine."""
    if network_of(learning.network).as_article:
        return learning.learning_rate
    done = step / max(learning.steps - 1, 1)
    if done < WARM_UP:
        return learning.learning_rate * max(done / WARM_UP, 0.04)
    fallen = 0.5 + 0.5 * np.cos(np.pi * (done - WARM_UP) / (1 - WARM_UP))
    # a plain number: it is saved
    return float(learning.learning_rate * (LAST_RATE + (1 - LAST_RATE) * fallen))
