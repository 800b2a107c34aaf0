"""Train the networks of ``models.without_position`` in torch, on simulated loops alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.examples import LoopExample, WindowsExample
from stemwatch.models.without_position.network import KERNELS, MOST_AWAY, LoopNetwork
from stemwatch.models.without_position.windows import PER_PERIOD, SIGNALS

ENSEMBLE = 5
_HIDDEN = (16, 12)
_CHANNELS = (24, 48, 64, 64)
_LENGTHS_HIDDEN, _DROPPED = 32, 0.2
_EPOCHS, _WINDOW_EPOCHS = 40, 24
_BATCH = 128


class _Convolutional(nn.Module):
    """``LoopNetwork.convolved`` in torch. Convolutions of two dimensions, of which one is 1, with
    the channels last are a third quicker on a processor."""

    def __init__(self) -> None:
        super().__init__()
        sizes = (SIGNALS, *_CHANNELS)
        self.layers = nn.ModuleList(
            nn.Conv2d(sizes[i], sizes[i + 1], (1, width), stride=(1, stride))
            for i, (width, stride) in enumerate(KERNELS)
        )
        self.lengths = nn.Linear(2 * _CHANNELS[-1] * len(PER_PERIOD), _LENGTHS_HIDDEN)
        self.out = nn.Linear(_LENGTHS_HIDDEN, 1)

    def forward(self, loops: Tensor) -> Tensor:
        """(b,) logits of ``loops`` (b, lengths, stretches, signals, n)."""
        signal = loops.flatten(0, 2).unsqueeze(2).contiguous(memory_format=torch.channels_last)
        for layer in self.layers:
            signal = torch.relu(layer(signal))
        pooled = torch.cat([signal.mean(dim=(2, 3)), signal.amax(dim=(2, 3))], dim=1)
        of_lengths = pooled.reshape(*loops.shape[:3], -1).mean(dim=2).flatten(1)
        hidden = nn.functional.dropout(of_lengths, _DROPPED, self.training)
        logits: Tensor = self.out(torch.relu(self.lengths(hidden))).squeeze(1)
        return logits

    def arrays(self) -> dict[str, Floats]:
        """The weights under the names that ``LoopNetwork`` reads them by."""
        named = {
            name: parameter.detach().double().cpu().numpy()
            for name, parameter in self.named_parameters()
        }
        arrays = {}
        for place in range(len(KERNELS)):
            arrays[f"conv{place + 1}"] = named[f"layers.{place}.weight"][:, :, 0]
            arrays[f"conv{place + 1}_bias"] = named[f"layers.{place}.bias"]
        arrays |= {"lengths": named["lengths.weight"], "lengths_bias": named["lengths.bias"]}
        return arrays | {"curves": named["out.weight"][0], "curves_bias": named["out.bias"]}


def train(
    examples: Sequence[LoopExample],
    *,
    seed: int,
    windows_examples: Sequence[WindowsExample] = (),
    epochs: int = _EPOCHS,
    window_epochs: int = _WINDOW_EPOCHS,
) -> LoopNetwork:
    """The networks trained on ``examples``, the convolutional one on ``windows_examples`` as well:
    one seed, one result on one machine.

    Loss: cross entropy of the label, and for sticking loops the Gaussian likelihood of
    ln(S/amplitude). Examples that are ``held_back`` are used only to turn the sum of both networks
    into a probability and to set the spread of S.
    """
    torch.manual_seed(seed)
    in_training = np.array([not example.held_back for example in examples])
    values = np.array([example.values for example in examples])
    sticky = np.array([example.sticky for example in examples], dtype=np.float64)
    log_S = np.array([example.log_S for example in examples])
    mean, scale = values[in_training].mean(axis=0), values[in_training].std(axis=0) + 1e-6
    scaled = torch.tensor(np.clip((values - mean) / scale, -MOST_AWAY, MOST_AWAY)).float()
    dense = _train_dense(scaled, sticky, log_S, in_training, epochs)
    arrays: dict[str, Floats] = {"mean": mean, "scale": scale, **dense}
    curves = [examples[k] for k in np.flatnonzero(in_training).tolist()] + list(windows_examples)
    arrays |= _train_convolutional(
        torch.tensor(np.stack([loop.windows for loop in curves])),
        torch.tensor([loop.sticky for loop in curves]).float(),
        window_epochs,
    )
    arrays |= {"weigh": np.array([1.0, 0.0, 0.0]), "spread": np.ones(1)}
    return _weighed(arrays, examples, sticky, log_S, in_training)


def _train_dense(
    scaled: Tensor, sticky: Floats, log_S: Floats, in_training: np.ndarray, epochs: int
) -> dict[str, Floats]:
    """An ensemble side by side, each on its own batches."""
    inputs = scaled.shape[1]
    shapes = ((_HIDDEN[0], inputs), (_HIDDEN[1], _HIDDEN[0]), (3, _HIDDEN[1]))
    weights = [nn.Parameter(torch.randn(ENSEMBLE, *shape) / np.sqrt(shape[1])) for shape in shapes]
    biases = [nn.Parameter(torch.zeros(ENSEMBLE, shape[0])) for shape in shapes]
    optimiser = torch.optim.AdamW([*weights, *biases], lr=3e-3, weight_decay=0.05)
    places = torch.tensor(np.flatnonzero(in_training))
    steps = epochs * max(len(places) // _BATCH, 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 6e-3, total_steps=steps)
    label, target = torch.tensor(sticky), torch.tensor(np.nan_to_num(log_S))
    for _ in range(steps):
        batch = places[torch.randint(len(places), (ENSEMBLE, _BATCH))]
        x = scaled[batch] + 0.1 * torch.randn(ENSEMBLE, _BATCH, inputs)
        for layer in range(2):
            x = torch.tanh(torch.einsum("ebi,ehi->ebh", x, weights[layer]) + biases[layer][:, None])
        out = torch.einsum("ebi,ehi->ebh", x, weights[2]) + biases[2][:, None]
        batch_labels, size = label[batch], target[batch]
        loss = nn.functional.binary_cross_entropy_with_logits(out[..., 0], batch_labels.float())
        spread = out[..., 2].clamp(-4.0, 2.0)
        size_loss = spread + 0.5 * ((size - out[..., 1]) * torch.exp(-spread)) ** 2
        loss = loss + 0.5 * (size_loss * batch_labels).sum() / batch_labels.sum().clamp(min=1.0)
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
    names = zip(("1", "2", "3"), weights, biases, strict=True)
    return {
        f"{kind}{index}": array.detach().double().numpy()
        for index, weight, bias in names
        for kind, array in (("dense", weight), ("bias", bias))
    }


def _train_convolutional(loops: Tensor, sticky: Tensor, epochs: int) -> dict[str, Floats]:
    """``loops`` (n, lengths, stretches, signals, LENGTH), in half precision because of their
    number. A processor that has instructions for bfloat16 multiplies in it, twice as quick; one
    that would emulate them would need fifteen times as long as in single precision. A graphics
    card is quick enough."""
    device = "cuda" if torch.cuda.is_available() else "cpu"
    in_bfloat16 = device == "cpu" and torch.cpu._is_avx512_bf16_supported()
    network = _Convolutional().to(device)
    loops, label = loops.to(device), (0.02 + 0.96 * sticky).to(device)
    optimiser = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=0.02)
    steps = max(epochs * len(loops) // _BATCH, 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps)
    for _ in range(steps):
        batch = torch.randint(len(loops), (_BATCH,), device=device)
        with torch.autocast(device, dtype=torch.bfloat16, enabled=in_bfloat16):
            logits = network(_varied(loops[batch].float()))
        loss = nn.functional.binary_cross_entropy_with_logits(logits.float(), label[batch])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
    return network.arrays()


def _varied(loops: Tensor) -> Tensor:
    """Data augmentation that does not change whether a loop sticks: all upside down, PV reversed,
    without SP, with an SP far from PV, with noise.
    """
    count, device = len(loops), loops.device

    def random_rows(share: float) -> Tensor:
        return torch.rand(count, device=device) < share

    sign = torch.where(random_rows(0.5), -1.0, 1.0)
    turned = sign * torch.where(random_rows(0.1), -1.0, 1.0)
    kept = torch.where(random_rows(0.15), 0.0, 1.0)
    signs = torch.stack([sign, turned, turned * kept], dim=1)[:, None, None, :, None]
    varied = loops * signs
    varied[:, :, :, 2] += (5.0 * turned * random_rows(0.03))[:, None, None, None]
    size = 0.12 * torch.rand(count, 1, 1, 1, 1, device=device)
    varied[:, :, :, :2] += size * torch.randn_like(varied[:, :, :, :2])
    return varied


def _weighed(
    arrays: dict[str, Floats],
    examples: Sequence[LoopExample],
    sticky: Floats,
    log_S: Floats,
    in_training: np.ndarray,
) -> LoopNetwork:
    """Equal weights for both networks, because each is the better one on some simulator. A logistic
    regression on the loops that neither was trained on turns the sum into a probability, and the
    spread of S is widened until it holds 95 % of these.
    """
    network = LoopNetwork(arrays)
    held_back = np.flatnonzero(~in_training).tolist()
    heads = np.array([network.dense(examples[k].values) for k in held_back])
    curves = np.array([network.by_curves(examples[k].windows) for k in held_back])
    x = np.column_stack([0.5 * (heads[:, 0] + curves), np.ones(len(held_back))])
    beta = np.array([1.0, 0.0])
    for _ in range(50):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ beta, -30.0, 30.0)))
        slope = x.T @ (p - sticky[held_back]) + 1e-3 * beta
        curvature = (x * (p * (1.0 - p))[:, None]).T @ x + 1e-3 * np.eye(2)
        beta = beta - np.linalg.solve(curvature, slope)
    steep = max(float(beta[0]), 0.0)
    arrays["weigh"] = np.array([0.5 * steep, 0.5 * steep, beta[1]])
    likely = (sticky[held_back] > 0.0) & (x @ beta > 0.0)
    if likely.any():
        error_in_spreads = np.abs(log_S[held_back] - heads[:, 1])[likely] / np.exp(heads[likely, 2])
        arrays["spread"] = np.array([np.percentile(error_in_spreads, 95.0) / 1.96])
    return LoopNetwork(arrays)
