"""Which loops oscillate together: they are coherent at a common period by more than chance.

The strongest oscillation of a loop that is not explained yet is the first reference. Loops whose
spectra around its period are coherent with it join; the reference becomes what the members have in
common (the first principal component of their spectra). Loads that travel from loop to loop look
similar, but weaker: the size of the common part, the regularity of the periods, and signs of a
sticking valve decide whether the candidate is a group. In a short record unrelated loops look alike
too, so that chance must hardly make such a one. The part that a group explains is subtracted from
all loops, and the search goes on. So a loop may belong to several groups.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy.linalg import eigh

from stemwatch.models.oscillation_groups.chance import log_chances, log_expected
from stemwatch.models.oscillation_groups.limits import GroupLimits
from stemwatch.models.oscillation_groups.loop_spectra import (
    Complexes,
    LoopOscillation,
    LoopSpectra,
    oscillations,
)
from stemwatch.models.recording import Bools, Floats

BAND = 0.25  # half width of a group's band, relative: limit cycles wander
_BINS_A_TERM = 3  # at least, so that noise is not taken for what is common
_SMOOTH = 4  # terms of the smooth transfer function from the reference to a loop, over the band
_ALIKE = 0.15  # relative difference of periods of one oscillation
_MOST_GROUPS = 40
_HARMONICS = (2.0, 3.0, 4.0, 5.0, 6.0, 7.0)
_HARMONIC_MATCH = 0.025
_BOUND = 0.8  # coherence, from which a harmonic is phase-locked
_LEAST_REGULARITY = 0.3
_NEAR = 0.03  # relative half width within which power is looked at for gaps
_GAP = 0.02  # of the largest power that is left in one


NOT_ASKED: Mapping[int, float] = MappingProxyType({})


@dataclass(frozen=True, kw_only=True)
class FoundGroup:
    """Loops that oscillate with one period.

    ``members`` (k,) their numbers; ``shares`` (k,) of each PV's variance that the oscillation
    makes; ``coherence`` (k,) with the reference, in the band; ``reference`` (bins,) the common
    spectrum, of unit length; ``statistics`` (4,) the evidence for an oscillation rather than a
    load that travels, in the order of the weights; ``parts`` (k, bins) the spectra in which the
    members were found to be coherent, of ``compared`` loops that move enough in the band.
    """

    frequency: float
    members: tuple[int, ...]
    shares: tuple[float, ...]
    coherence: tuple[float, ...]
    regularity: float  # median over the members that oscillate by themselves
    reference: Complexes
    band: slice
    statistics: Floats
    parts: Complexes
    compared: int

    @property
    def period_s(self) -> float:
        return 1.0 / self.frequency

    @property
    def weaker_of_two(self) -> float:
        """The share of the weaker loop of two; infinite where there are more."""
        return min(self.shares) if len(self.members) == 2 else np.inf


def find_groups(
    spectra: LoopSpectra,
    pv: LoopSpectra,
    limits: GroupLimits,
    sticking: Mapping[int, float] = NOT_ASKED,
) -> list[FoundGroup]:
    """The groups, the strongest first. ``spectra`` are those of SP - PV, ``pv`` those of PV, of the
    same loops on the same clock. ``sticking``: the log odds from OP and PV that a loop's
    valve sticks, where they are known.
    """
    seen = oscillations(spectra)
    remaining = spectra.spectra.copy()
    open_ = sorted(
        (peak for peak in seen if peak.share >= limits.share), key=lambda peak: -peak.share
    )
    groups: list[FoundGroup] = []
    searches = len(open_)
    while open_ and len(groups) < _MOST_GROUPS:
        first = open_.pop(0)
        group = candidate(first, spectra, pv, remaining, seen, limits, sticking)
        if group is None or not more_than_chance(group, limits, searches):
            continue
        members = set(group.members)
        open_ = [
            peak
            for peak in open_
            if not (peak.loop in members and _near(peak.frequency, group.frequency, BAND))
        ]
        group = _with_harmonics(spectra, pv, remaining, group, limits)
        if not any(_is_harmonic(group, other) for other in groups):
            groups.append(group)
    return sorted(groups, key=lambda group: -sum(group.shares))


def more_than_chance(group: FoundGroup, limits: GroupLimits, searches: int) -> bool:
    """Whether a candidate is a group: unrelated loops would hardly be as coherent in one of so many
    ``searches``, the evidence reaches its limit, and two loops alone share clearly more than the
    least of a member.
    """
    if group.weaker_of_two < limits.pair_share:
        return False
    if group.statistics @ np.array(limits.weights) < limits.evidence:
        return False
    chances = log_chances(group.parts, _basis, _first_component)
    expected = np.exp(log_expected(chances, group.compared, searches))
    return bool(expected <= limits.by_chance)


def _near(a: float, b: float, relative: float) -> bool:
    return bool(abs(np.log(a / b)) <= relative)


def candidate(
    first: LoopOscillation,
    spectra: LoopSpectra,
    pv: LoopSpectra,
    remaining: Complexes,
    seen: Sequence[LoopOscillation],
    limits: GroupLimits,
    sticking: Mapping[int, float],
) -> FoundGroup | None:
    """The candidate group around an oscillation in ``remaining`` (m, f), whether or not it is more
    than chance; ``None`` where no second loop joins.
    """
    band = _band_of(spectra, remaining, first, limits.share)
    parts = remaining[:, band]
    power = np.maximum((np.abs(parts) ** 2).sum(axis=1), 1e-30)
    if power[first.loop] < limits.share:
        return None
    basis = _basis(parts[first.loop] / float(np.sqrt(power[first.loop])))
    for _ in range(3):
        along = (np.abs(parts @ basis.conj()) ** 2).sum(axis=1)
        common = _beyond_noise(along, power, basis.shape)
        coherence = np.sqrt(along / power)
        in_group: Bools = (common >= limits.share) & (coherence >= limits.coherence)
        if in_group.sum() < 2 or not in_group[first.loop]:
            return None
        weighed = parts[in_group] * coherence[in_group, None] ** 2
        basis = _basis(_first_component(weighed))
    reference = basis[:, 0]
    of_pv = _common(pv.spectra[:, band], basis)
    in_group &= of_pv >= limits.share
    if in_group.sum() < 2:
        return None
    members = np.flatnonzero(in_group)
    regular = [
        peak.regularity
        for peak in seen
        if in_group[peak.loop] and _near(peak.frequency, first.frequency, _ALIKE)
    ] or [first.regularity]
    weights = np.abs(reference) ** 2
    return FoundGroup(
        frequency=float(weights @ spectra.frequencies[band] / weights.sum()),
        members=tuple(int(i) for i in members),
        shares=tuple(float(x) for x in of_pv[members]),
        coherence=tuple(float(x) for x in coherence[members]),
        regularity=float(np.median(regular)),
        reference=reference,
        band=band,
        statistics=_statistics(
            of_pv[members], max(regular), [sticking.get(int(i)) for i in members]
        ),
        parts=parts[members],
        compared=int((power >= limits.share).sum()),
    )


def _band_of(
    spectra: LoopSpectra, remaining: Complexes, first: LoopOscillation, share: float
) -> slice:
    """The bins within a quarter of an oscillation's frequency, without what lies behind a gap in
    the spectrum of its loop and is another oscillation, of at least ``share`` of some loop: with
    both in one band a smooth transfer function could make each of the other."""
    band = spectra.within(first.frequency * (1.0 - BAND), first.frequency * (1.0 + BAND))
    power = np.abs(remaining[:, band]) ** 2
    bins = np.arange(band.start, band.stop)
    half = max(1, round(_NEAR * first.frequency * spectra.size * spectra.interval_s))
    smooth = np.convolve(power[first.loop], np.ones(2 * half + 1), mode="same")
    top = int(smooth.argmax())
    gaps = np.flatnonzero(smooth < _GAP * smooth[top])
    below, above = gaps[gaps < top], gaps[gaps > top]
    low, high = 0, bins.size
    if below.size and power[:, : below[-1] + 1].sum(axis=1).max() >= share:
        low = int(below[-1]) + 1
    if above.size and power[:, above[0] :].sum(axis=1).max() >= share:
        high = int(above[0])
    return slice(band.start + low, band.start + high)


def _first_component(parts: Complexes) -> Complexes:
    """(bins,) the first right singular vector of (k, bins), from the smaller of the two products of
    the matrix with itself: a sixth to a quarter of the time of all singular vectors.
    """
    loops, bins = parts.shape
    adjoint = parts.conj().T
    product = parts @ adjoint if loops < bins else adjoint @ parts
    last = product.shape[0] - 1
    _, vectors = eigh(product, subset_by_index=(last, last))
    row = np.asarray(vectors[:, 0].conj())
    if loops < bins:
        row = row @ parts
    return np.asarray(row / np.linalg.norm(row))


def _common(part: Complexes, basis: Complexes) -> Floats:
    """(m,) power of ``part`` (m, bins) along a basis, beyond that of noise."""
    along = (np.abs(part @ basis.conj()) ** 2).sum(axis=1)
    return _beyond_noise(along, (np.abs(part) ** 2).sum(axis=1), basis.shape)


def _beyond_noise(along: Floats, power: Floats, shape: tuple[int, ...]) -> Floats:
    """(m,) power along a basis of (bins, terms) beyond the power expected from noise as strong as
    the rest.
    """
    bins, terms = shape
    noise = (power - along) * (terms / max(bins - terms, 1))
    return np.asarray(np.maximum(along - noise, 0.0))


def _statistics(shares: Floats, regularity: float, sticking: Sequence[float | None]) -> Floats:
    """(4,) the evidence for a group, in the order of the weights. The number of members is not
    among it, because a load common to all loops is not an oscillation. The odds of a loop count by
    its share: a valve that sticks moves its own loop most, and at another period it is no evidence
    for this group.
    """
    by_share = [
        odds + float(np.log(share))
        for share, odds in zip(shares, sticking, strict=True)
        if odds is not None
    ]
    return np.array(
        [
            1.0,
            np.log(shares.max()),
            np.log(max(regularity, _LEAST_REGULARITY)),
            max(by_share, default=float(np.log(shares.max()))),
        ]
    )


def _basis(reference: Complexes) -> Complexes:
    """(bins, 4), or fewer over a narrow band, orthonormal: the reference times the first powers of
    the frequency. Their span contains the reference behind any smooth transfer function, such as a
    lag or a dead time.
    """
    grid = np.linspace(-1.0, 1.0, reference.size)
    terms = max(1, min(_SMOOTH, reference.size // _BINS_A_TERM))
    powers = np.stack([reference * grid**k for k in range(terms)], axis=1)
    q, _ = np.linalg.qr(powers)
    return np.asarray(q)


def _take_out(remaining: Complexes, group: FoundGroup) -> None:
    """Subtract the part that the group explains from all loops."""
    basis = _basis(group.reference)
    part = remaining[:, group.band]
    remaining[:, group.band] = part - (part @ basis.conj()) @ basis.T


def _with_harmonics(
    spectra: LoopSpectra,
    pv: LoopSpectra,
    remaining: Complexes,
    group: FoundGroup,
    limits: GroupLimits,
) -> FoundGroup:
    """The group with its harmonics, which are subtracted from all loops too: waves of 2 to 7 times
    the frequency, locked to its phase. A loop to which the oscillation comes with harmonics that
    make up for a small fundamental becomes a member.
    """
    basis, part = _basis(group.reference), remaining[:, group.band]
    along = (np.abs(part @ basis.conj()) ** 2).sum(axis=1)
    coherence = np.sqrt(along / np.maximum((np.abs(part) ** 2).sum(axis=1), 1e-30))
    shares = _common(pv.spectra[:, group.band], basis)
    _take_out(remaining, group)
    wave = spectra.time(group.reference[None, :], group.band)[0]
    size = np.abs(wave)
    turn = wave / np.maximum(size, 1e-30)
    for k in _HARMONICS:
        low, high = k * group.frequency * (1.0 - BAND / k), k * group.frequency * (1.0 + BAND / k)
        if high >= spectra.frequencies[-1]:
            break
        band = spectra.within(low, high)
        reference = np.fft.fft(size * turn ** int(k))[band]
        basis = _basis(reference / max(float(np.linalg.norm(reference)), 1e-30))
        part = remaining[:, band]
        projected = part @ basis.conj()
        power = np.maximum((np.abs(part) ** 2).sum(axis=1), 1e-30)
        bound = (np.abs(projected) ** 2).sum(axis=1) >= _BOUND**2 * power
        remaining[:, band] = part - np.where(bound[:, None], projected, 0.0) @ basis.T
        shares += np.where(bound, _common(pv.spectra[:, band], basis), 0.0)
    members = np.flatnonzero((coherence >= limits.coherence) & (shares >= limits.share))
    return replace(
        group,
        members=tuple(int(i) for i in members),
        shares=tuple(float(shares[i]) for i in members),
        coherence=tuple(float(coherence[i]) for i in members),
    )


def _is_harmonic(group: FoundGroup, other: FoundGroup) -> bool:
    ratio = group.frequency / other.frequency
    if not any(abs(ratio / k - 1.0) <= _HARMONIC_MATCH for k in _HARMONICS):
        return False
    shared = len(set(group.members) & set(other.members))
    return shared >= 0.5 * len(group.members)


def strength_over_time(
    spectra: LoopSpectra, group: FoundGroup, windows: int
) -> tuple[Floats, Floats]:
    """(windows,) the oscillation's amplitude over the record, its mean square 1, and the amplitude
    at each of ``size`` samples."""
    wave = np.abs(spectra.time(group.reference[None, :], group.band)[0])
    parts = np.array_split(wave**2, windows)
    level = np.sqrt(np.array([part.mean() for part in parts]))
    return level / max(float(np.sqrt(np.mean(wave**2))), 1e-12), wave
