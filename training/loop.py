"""The loop that both pixel networks are trained by: a cosine over the steps, a moving average of the weights, checkpoints to go on from."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import nn

_SAVED = 250  # steps between checkpoints
_WARM = 60  # steps until the rate is full
_LEAST = 0.02  # of the rate, at the end

Loss = Callable[[nn.Module, np.random.Generator], torch.Tensor]


def train(
    net: nn.Module, loss_of: Loss, out: Path, *, steps: int, rate: float, decay: float, seed: int,
    told: Callable[[nn.Module, int], str] = lambda average, step: "",
) -> None:  # fmt: skip
    """Trains net by AdamW on loss_of(net, rng) and writes ``out``: net, average (what is exported), optimiser, step.

    Goes on from ``out`` where it exists; the examples of a step depend on the seed and on where training was taken up. Losses should run
    the network in bfloat16 (half the time on processors that know it). told: what to print beside the loss, by the average so far.
    """
    average = copy.deepcopy(net)
    optimiser = torch.optim.AdamW(net.parameters(), rate, weight_decay=decay)
    step = 0
    if out.exists():
        state = torch.load(out)
        net.load_state_dict(state["net"])
        average.load_state_dict(state["average"])
        optimiser.load_state_dict(state["optimiser"])
        step = state["step"]
    rng = np.random.default_rng([seed, step])
    recent: list[float] = []
    while step < steps:
        share = 0.5 * (1 + math.cos(math.pi * step / steps))
        for group in optimiser.param_groups:
            group["lr"] = rate * min(1.0, (step + 1) / _WARM) * (_LEAST + (1 - _LEAST) * share)
        net.train()
        value = loss_of(net, rng)
        optimiser.zero_grad()
        value.backward()
        nn.utils.clip_grad_norm_(net.parameters(), 5.0)
        optimiser.step()
        step += 1
        keep = min(0.998, (step + 1) / (step + 10))
        with torch.no_grad():
            for mine, theirs in zip(average.state_dict().values(), net.state_dict().values(), strict=True):
                mine.lerp_(theirs, 1 - keep) if mine.dtype.is_floating_point else mine.copy_(theirs)
        recent.append(float(value.detach()))
        if step % _SAVED == 0 or step == steps:
            state = {"net": net.state_dict(), "average": average.state_dict(), "optimiser": optimiser.state_dict()}
            part = out.with_suffix(".part")
            torch.save(state | {"step": step}, part)
            part.rename(out)
            print(f"step {step}: loss {np.mean(recent):.3f}{told(average, step)}", flush=True)
            recent.clear()
