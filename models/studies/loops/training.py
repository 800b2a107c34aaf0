"""Train the networks of ``models.without_position`` in torch, on simulated loops alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from stemwatch.models.recording import Floats
from stemwatch.models.studies.loops.examples import LoopExample, WindowsExample
from stemwatch.models.without_position.network import KERNELS, MOST_AWAY, LoopNetwork

ENSEMBLE = 5
_HIDDEN = (16, 12)
_CHANNELS = (24, 48, 64, 64)
_EPOCHS, _WINDOW_EPOCHS = 40, 12
_BATCH = 128
_HELD_BACK = 5  # one loop of five is used to weight the two networks and not to train them


class _Convolutional(nn.Module):
    def __init__(self) -> None:
        super().__init__()
        sizes = (3, *_CHANNELS)
        self.layers = nn.ModuleList(
            nn.Conv1d(sizes[i], sizes[i + 1], width, stride=stride)
            for i, (width, stride) in enumerate(KERNELS)
        )
        self.out = nn.Linear(2 * _CHANNELS[-1], 1)

    def forward(self, signal: Tensor) -> Tensor:
        for layer in self.layers:
            signal = torch.relu(layer(signal))
        pooled = torch.cat([signal.mean(dim=2), signal.amax(dim=2)], dim=1)
        logits: Tensor = self.out(pooled).squeeze(1)
        return logits


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
    ln(S/amplitude). One example of ``_HELD_BACK`` is used only to weight the two networks and to
    set the spread of S.
    """
    torch.manual_seed(seed)
    in_training = np.arange(len(examples)) % _HELD_BACK != 0
    values = np.array([example.values for example in examples])
    sticky = np.array([example.sticky for example in examples], dtype=np.float64)
    log_S = np.array([example.log_S for example in examples])
    mean, scale = values[in_training].mean(axis=0), values[in_training].std(axis=0) + 1e-6
    scaled = torch.tensor(np.clip((values - mean) / scale, -MOST_AWAY, MOST_AWAY)).float()
    dense = _train_dense(scaled, sticky, log_S, in_training, epochs)
    arrays: dict[str, Floats] = {"mean": mean, "scale": scale, **dense}
    training_windows = [
        (examples[k].windows, examples[k].sticky) for k in np.flatnonzero(in_training).tolist()
    ]
    training_windows += [
        (windows_example.windows, windows_example.sticky) for windows_example in windows_examples
    ]
    arrays |= _train_convolutional(training_windows, window_epochs)
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


def _train_convolutional(
    training_windows: Sequence[tuple[Floats, bool]], epochs: int
) -> dict[str, Floats]:
    network = _Convolutional()
    cut = torch.tensor(np.concatenate([part for part, _ in training_windows]))
    of_window = np.concatenate([np.full(len(part), sticks) for part, sticks in training_windows])
    label = torch.tensor(0.02 + 0.96 * of_window, dtype=torch.float32)
    # Every loop counts the same, however many windows it has.
    share = np.concatenate([np.full(len(part), 1.0 / len(part)) for part, _ in training_windows])
    ends = torch.tensor(np.cumsum(share) / share.sum())
    optimiser = torch.optim.AdamW(network.parameters(), lr=2e-3, weight_decay=0.02)
    steps = max(epochs * len(cut) // _BATCH, 1)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 5e-3, total_steps=steps)
    for _ in range(steps):
        batch = torch.searchsorted(ends, torch.rand(_BATCH, dtype=ends.dtype)).clamp(
            max=len(cut) - 1
        )
        loss = nn.functional.binary_cross_entropy_with_logits(
            network(_varied(cut[batch])), label[batch]
        )
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
    arrays = {}
    for index, layer in enumerate(network.layers, start=1):
        arrays[f"conv{index}"] = layer.weight.detach().double().numpy()  # type: ignore[operator]
        arrays[f"conv_bias{index}"] = layer.bias.detach().double().numpy()  # type: ignore[operator]
    arrays["conv_out"] = network.out.weight.detach().double().numpy()[0]
    arrays["conv_out_bias"] = network.out.bias.detach().double().numpy()
    return arrays


def _varied(windows: Tensor) -> Tensor:
    """Data augmentation that does not change whether a loop sticks: windows upside down, PV
    reversed, without SP, with noise.
    """
    count = len(windows)

    def random_rows(share: float) -> Tensor:
        return torch.rand(count) < share

    sign = torch.where(random_rows(0.5), -1.0, 1.0)
    turned = sign * torch.where(random_rows(0.1), -1.0, 1.0)
    keep_factor = torch.where(random_rows(0.15), 0.0, 1.0)
    signs = torch.stack([sign, turned, turned * keep_factor], dim=1)[..., None]
    noise = 0.12 * torch.rand(count, 1, 1) * torch.randn(count, 2, windows.shape[2])
    varied = windows * signs
    varied[:, :2] += noise
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
    curves = np.array([network.convolved(examples[k].windows).mean() for k in held_back])
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
