"""Which loops oscillate together: coherent at a common period, and regular.

The strongest regular oscillation that is not explained yet is the first reference. Loops whose
spectra around its period are coherent with it join; the reference becomes what the members have in
common (the first principal component of their spectra); what it explains is taken out of all
loops, and the search goes on. So a loop may belong to several groups.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from stemwatch.models.oscillation_groups.limits import GroupLimits
from stemwatch.models.oscillation_groups.loop_spectra import (
    Complexes,
    LoopOscillation,
    LoopSpectra,
    oscillations,
)
from stemwatch.models.recording import Bools, Floats

BAND = 0.25  # half width of a group's band, relative: limit cycles wander
_SMOOTH = 3  # terms of the way from what is common to a loop, over the band
_ALIKE = 0.1  # relative difference of periods of one oscillation
_MOST_GROUPS = 40
_HARMONICS = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
_HARMONIC_MATCH = 0.025


@dataclass(frozen=True, kw_only=True)
class FoundGroup:
    """Loops that oscillate with one period.

    ``members`` (k,) their numbers; ``shares`` (k,) of each one's variance that the oscillation
    makes; ``coherence`` (k,) with what they have in common, in the band; ``reference`` (bins,) that
    common spectrum, of unit length.
    """

    frequency: float
    members: tuple[int, ...]
    shares: tuple[float, ...]
    coherence: tuple[float, ...]
    regularity: float  # the middle one of the members that show it by themselves
    reference: Complexes
    band: slice

    @property
    def period_s(self) -> float:
        return 1.0 / self.frequency


def find_groups(
    spectra: LoopSpectra, limits: GroupLimits, of_each_loop: Sequence[LoopOscillation] | None = None
) -> list[FoundGroup]:
    """The groups, the strongest first. ``of_each_loop``: ``oscillations(spectra)`` where it is
    known."""
    seen = [peak for peak in of_each_loop or oscillations(spectra) if _counts(peak, limits)]
    remaining = spectra.spectra.copy()
    open_ = sorted(seen, key=lambda peak: -peak.share)
    groups: list[FoundGroup] = []
    while open_ and len(groups) < _MOST_GROUPS:
        first = open_.pop(0)
        group = _around(first, spectra, remaining, seen, limits)
        if group is None:
            continue
        members = set(group.members)
        open_ = [
            peak
            for peak in open_
            if not (peak.loop in members and _near(peak.frequency, group.frequency, BAND))
        ]
        group = _with_harmonics(spectra, remaining, group, limits)
        if not any(_is_harmonic(group, other) for other in groups):
            groups.append(group)
    return sorted(groups, key=lambda group: -sum(group.shares))


def _counts(peak: LoopOscillation, limits: GroupLimits) -> bool:
    return (
        peak.regularity >= limits.regularity
        and peak.prominence >= limits.prominence
        and peak.share >= limits.share
    )


def _near(a: float, b: float, relative: float) -> bool:
    return bool(abs(np.log(a / b)) <= relative)


def _around(
    first: LoopOscillation,
    spectra: LoopSpectra,
    remaining: Complexes,
    seen: Sequence[LoopOscillation],
    limits: GroupLimits,
) -> FoundGroup | None:
    """The group of an oscillation; ``None`` where fewer than two loops show it by themselves."""
    band = spectra.within(first.frequency * (1.0 - BAND), first.frequency * (1.0 + BAND))
    parts = remaining[:, band]
    power = (np.abs(parts) ** 2).sum(axis=1)
    reference = parts[first.loop] / max(float(np.sqrt(power[first.loop])), 1e-12)
    near_peaks = [peak for peak in seen if _near(peak.frequency, first.frequency, _ALIKE)]
    of_group = np.zeros(parts.shape[0], dtype=bool)
    of_group[[one.loop for one in near_peaks]] = True
    in_group: Bools = of_group
    basis = _basis(reference)
    for _ in range(4):
        common = (np.abs(parts @ basis.conj()) ** 2).sum(axis=1)
        coherence = np.sqrt(common / np.maximum(power, 1e-30))
        in_group = (common >= limits.share) & (coherence >= limits.coherence)
        if in_group.sum() < 2 or not in_group[first.loop]:
            return None
        _, _, vectors = np.linalg.svd(parts[in_group], full_matrices=False)
        basis = _basis(vectors[0])
    reference = basis[:, 0]
    members = np.flatnonzero(in_group)
    regular = [peak.regularity for peak in near_peaks if in_group[peak.loop]] or [first.regularity]
    weights = np.abs(reference) ** 2
    frequency = float(weights @ spectra.frequencies[band] / weights.sum())
    return FoundGroup(
        frequency=frequency,
        members=tuple(int(i) for i in members),
        shares=tuple(float(x) for x in common[members]),
        coherence=tuple(float(x) for x in coherence[members]),
        regularity=float(np.median(regular)),
        reference=reference,
        band=band,
    )


def _basis(reference: Complexes) -> Complexes:
    """(bins, 3) orthonormal: the reference, and it times the frequency's first powers. What lies
    in their span has passed a smooth transfer function, such as a lag or a dead time."""
    grid = np.linspace(-1.0, 1.0, reference.size)
    powers = np.stack([reference * grid**k for k in range(min(_SMOOTH, reference.size))], axis=1)
    q, _ = np.linalg.qr(powers)
    return np.asarray(q)


def _take_out(remaining: Complexes, group: FoundGroup) -> None:
    """What the group explains, of all loops."""
    basis = _basis(group.reference)
    part = remaining[:, group.band]
    remaining[:, group.band] = part - (part @ basis.conj()) @ basis.T


def _with_harmonics(
    spectra: LoopSpectra, remaining: Complexes, group: FoundGroup, limits: GroupLimits
) -> FoundGroup:
    """The group with the share that its harmonics make, which are taken out of all loops too:
    waves that are 2 to 7 times as quick and bound to its phase."""
    _take_out(remaining, group)
    wave = spectra.time(group.reference[None, :], group.band)[0]
    size = np.abs(wave)
    turn = wave / np.maximum(size, 1e-30)
    shares = np.array(group.shares)
    for k in _HARMONICS:
        low, high = k * group.frequency * (1.0 - BAND / k), k * group.frequency * (1.0 + BAND / k)
        if high >= spectra.frequencies[-1]:
            break
        band = spectra.within(low, high)
        reference = np.fft.fft(size * turn ** int(k))[band]
        basis = _basis(reference / max(float(np.linalg.norm(reference)), 1e-30))
        part = remaining[:, band]
        along = part @ basis.conj()
        common = (np.abs(along) ** 2).sum(axis=1)
        power = np.maximum((np.abs(part) ** 2).sum(axis=1), 1e-30)
        bound = common >= limits.coherence**2 * power
        remaining[:, band] = part - np.where(bound[:, None], along, 0.0) @ basis.T
        shares += np.where(bound, common, 0.0)[list(group.members)]
    return replace(group, shares=tuple(float(share) for share in shares))


def _is_harmonic(group: FoundGroup, other: FoundGroup) -> bool:
    ratio = group.frequency / other.frequency
    if not any(abs(ratio / k - 1.0) <= _HARMONIC_MATCH for k in _HARMONICS):
        return False
    shared = len(set(group.members) & set(other.members))
    return shared >= 0.5 * len(group.members)


def labels(groups: Sequence[FoundGroup], loops: int) -> list[int]:
    """The group that makes most of each loop's variance, -1 for none."""
    best, label = np.zeros(loops), np.full(loops, -1)
    for number, group in enumerate(groups):
        for member, share in zip(group.members, group.shares, strict=True):
            if share > best[member]:
                best[member], label[member] = share, number
    return [int(number) for number in label]


def strength_over_time(
    spectra: LoopSpectra, group: FoundGroup, windows: int
) -> tuple[Floats, Floats]:
    """(windows,) the oscillation's amplitude over the record, its mean square 1, and the amplitude
    at each of ``size`` samples."""
    wave = np.abs(spectra.time(group.reference[None, :], group.band)[0])
    parts = np.array_split(wave**2, windows)
    level = np.sqrt(np.array([part.mean() for part in parts]))
    return level / max(float(np.sqrt(np.mean(wave**2))), 1e-12), wave
