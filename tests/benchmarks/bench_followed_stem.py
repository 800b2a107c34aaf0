"""What a likelihood ratio adds whose process is fitted, beside the score without a position.

    python -m tests.benchmarks.bench_followed_stem [--train N] [--seed S ...] [--loops N]

Small networks weigh the numbers of ``models.without_position.features`` and the shipped networks'
answer, once without and once with the numbers of ``tests.benchmarks.followed_stem``. They learn
from own loops of seed ``--train-seed``; each result times P(S > 0.4 %), as the score has it, is
judged on the families of ``stemwatch study-without-position``.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from stemwatch.models.recording import Floats
from stemwatch.models.without_position.network import LoopScore
from stemwatch.models.without_position.no_sign import logit
from stemwatch.models.without_position.suspicion import (
    LEAST_S_PERCENT,
    estimated_S,
    look_at_loop,
    predicts_better,
    sticking_score,
    trained_judge,
    usable_signals,
)
from stemwatch.service.studies.detection_rates import area_under_roc, sensitivity
from stemwatch.service.studies.without_position.draw import FAMILIES, LoopToDraw
from tests.benchmarks.followed_stem import NAMES, followed_stem

ENSEMBLE, HIDDEN, BATCH, PASSES = 8, 16, 128, 40
FARTHEST, NOISE = 3.0, 0.1  # standard deviations of an input
ALARMS = (0.02, 0.05)


@dataclass(frozen=True, kw_only=True)
class Weighed:
    """A loop: what is weighed (``inputs``, those of ``NAMES`` last), the networks' probability and
    the score today, and whether the other rules let it be suspected."""

    family: str
    sticks: bool
    inputs: Floats
    likeness: float
    score: float
    may_alarm: bool


def look(item: LoopToDraw) -> Weighed | None:
    """The loop; ``None`` where it cannot be judged."""
    recording, S, _ = FAMILIES[item.family](item)
    seen = look_at_loop(recording)
    if seen.shown is None or seen.windows is None or seen.doubt is not None:
        return None
    answer = trained_judge().network.answer(seen.shown.values, seen.windows)
    op, pv, _, _ = usable_signals(recording)
    S_said = estimated_S(seen.shown, answer)
    return Weighed(
        family=item.family,
        sticks=S > 0.0,
        inputs=np.concatenate([seen.shown.values, said(answer), followed_stem(op, pv)]),
        likeness=answer.score,
        score=sticking_score(seen.shown, answer, seen.unit),
        may_alarm=predicts_better(seen.shown) and S_said >= LEAST_S_PERCENT,
    )


def said(answer: LoopScore) -> Floats:
    """(3,) what the networks say."""
    return np.array([float(logit(answer.score)), answer.log_S, np.log(answer.spread)])


def weighed_anew(examples: Floats, sticks: Floats, loops: Floats, seed: int) -> Floats:
    """(n,) the probability that ``loops`` (n, w) stick, by networks that learned from ``examples``
    (m, w) and ``sticks`` (m,)."""
    torch.manual_seed(seed)
    middle, scale = examples.mean(axis=0), examples.std(axis=0) + 1e-9

    def scaled(values: Floats) -> torch.Tensor:
        return torch.tensor(np.clip((values - middle) / scale, -FARTHEST, FARTHEST)).float()

    x, label, wide = scaled(examples), torch.tensor(sticks).float(), examples.shape[1]
    parts = [
        torch.nn.Parameter(torch.randn(ENSEMBLE, wide, HIDDEN) / np.sqrt(wide)),
        torch.nn.Parameter(torch.zeros(ENSEMBLE, 1, HIDDEN)),
        torch.nn.Parameter(torch.randn(ENSEMBLE, HIDDEN, 1) / np.sqrt(HIDDEN)),
        torch.nn.Parameter(torch.zeros(ENSEMBLE, 1, 1)),
    ]

    def logits(values: torch.Tensor) -> torch.Tensor:
        return ((torch.tanh(values @ parts[0] + parts[1])) @ parts[2] + parts[3])[..., 0]

    optimiser = torch.optim.AdamW(parts, lr=6e-3, weight_decay=0.05)
    steps = PASSES * len(x) // BATCH
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 6e-3, total_steps=steps)
    for _ in range(steps):
        batch = torch.randint(len(x), (ENSEMBLE, BATCH))
        noisy = x[batch] + NOISE * torch.randn(ENSEMBLE, BATCH, wide)
        loss = torch.nn.functional.binary_cross_entropy_with_logits(logits(noisy), label[batch])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
    with torch.no_grad():
        mean = logits(scaled(loops).expand(ENSEMBLE, -1, -1)).mean(dim=0).double().numpy()
    return np.asarray(1.0 / (1.0 + np.exp(-mean)))


def looked(items: Iterable[LoopToDraw]) -> list[Weighed]:
    """Those that can be judged."""
    return [loop for loop in map(look, items) if loop is not None]


def table(loops: list[Weighed], scores: dict[str, Floats]) -> Iterator[str]:
    """A line for each family and score: AUC, and found at 2 and 5 % false alarms by all rules."""
    sticks = np.array([loop.sticks for loop in loops])
    may = np.array([loop.may_alarm for loop in loops])
    for family in dict.fromkeys(loop.family for loop in loops):
        of_family = np.array([loop.family == family for loop in loops])
        good, bad = of_family & sticks, of_family & ~sticks
        for name, score in scores.items():
            alarm = np.where(may, score, 0.0)
            at = [sensitivity(alarm[good], alarm[bad], share) for share in ALARMS]
            yield (
                f"| {family}, {good.sum()} + {bad.sum()} | {name} "
                f"| {area_under_roc(score[good], score[bad]):.2f} | {at[0]:.2f}, {at[1]:.2f} |"
            )


def main() -> None:
    """Learn, judge, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--train", type=int, default=2000)
    parser.add_argument("--train-seed", type=int, default=4060)
    parser.add_argument("--seed", type=int, nargs="+", default=[7171, 8181, 9393])
    parser.add_argument("--loops", type=int, default=100)
    asked = parser.parse_args()
    begun = time.process_time()
    examples = looked(LoopToDraw(asked.train_seed, place) for place in range(asked.train))
    loops = looked(
        LoopToDraw(seed, place, family)
        for family in FAMILIES
        for seed in asked.seed
        for place in range(asked.loops)
    )
    seconds = (time.process_time() - begun) / (asked.train + asked.loops * len(asked.seed) * 3)
    x, of_loops = (np.array([loop.inputs for loop in part]) for part in (examples, loops))
    sticks = np.array([float(loop.sticks) for loop in examples])
    share = np.array([loop.score / loop.likeness for loop in loops])
    scores = {"today": np.array([loop.score for loop in loops])}
    for name, kept in (("weighed anew", x.shape[1] - len(NAMES)), ("with the ratio", x.shape[1])):
        scores[name] = share * weighed_anew(x[:, :kept], sticks, of_loops[:, :kept], 1)
    print("| sticking + sound | score | AUC | found at 2, 5 % |\n|---|---|---|---|")
    print("\n".join(table(loops, scores)))
    print(f"{seconds:.2f} s of processor time a loop")


if __name__ == "__main__":
    main()
