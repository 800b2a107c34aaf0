"""What the record as a whole is asked, after trajectories: dwell beside what they have named, what
the likelihood shows, a stem that sticks again, dwell alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from collections.abc import Set as AbstractSet

from stemwatch.models.mismatch.search.drive import of_the_valve
from stemwatch.models.mismatch.search.dwell_beside import with_dwell
from stemwatch.models.mismatch.search.dwell_by_likelihood import (
    dwell_by_likelihood,
    without_unlikely_dwell,
)
from stemwatch.models.mismatch.search.named_by_likelihood import named_by_likelihood
from stemwatch.models.mismatch.search.named_terms import Named, shown_by_likelihood
from stemwatch.models.mismatch.search.reading_errors import RESTICK, STICKS_AGAIN
from stemwatch.models.mismatch.search.sticking_by_likelihood import sticking_by_likelihood
from stemwatch.models.mismatch.term import Term


class AskedOfTheWhole:
    """What the record as a whole is asked, once each, and the likelihood once more beside what it
    has shown, where all that was named so far stands. The readings of a flow that stands for the
    position are not independent of each other, and nothing is asked of them.
    """

    def __init__(self, own_reading: bool, terms: Mapping[str, Term]) -> None:
        self._left = [with_dwell, named_by_likelihood] if own_reading else []
        self._all = terms
        # Also where trajectories have proposed one that did not stand: they cannot show it.
        self.sticking = {slug: terms[slug] for slug in STICKS_AGAIN if slug in terms}
        self._may_stick = own_reading and RESTICK in self.sticking
        self._sliding: Named | None = None
        self._once_more = False  # whether the likelihood is asked beside what it has shown
        self._own_reading = self._may_dwell = own_reading

    def asked(self, named: Named, terms: Mapping[str, Term], stand: AbstractSet[str]) -> Named:
        """``named`` with what is found next, beside the effects that ``stand``; else as it was."""
        if self._own_reading and (fewer := without_unlikely_dwell(named)) is not named:
            return fewer
        for question in tuple(self._left):
            if question is with_dwell and not stand:
                continue  # alone it has been looked for
            self._left.remove(question)
            # What trajectories dropped may be what they could not show.
            sought = self._all if question is named_by_likelihood else terms
            more = question(named, of_the_valve(sought))
            if more is not named:
                # What the likelihood has shown may have hidden another.
                self._once_more = self._once_more or question is named_by_likelihood
                return more
        if self._once_more and shown_by_likelihood(named):
            self._once_more = False
            more = named_by_likelihood(named, of_the_valve(self._all))
            if more is not named:
                return more
        # Last, for a delay or a lag that was not looked for makes a stem seem to stick again.
        if self._may_stick and not stand & set(STICKS_AGAIN):
            self._may_stick, self._sliding = False, named
            more = sticking_by_likelihood(named)
            if more is not named:
                return more
        # A stem that is seen to stick again, or anything else, makes some rests look like dwell.
        if stand or not self._may_dwell:
            return named
        self._may_dwell = False
        return dwell_by_likelihood(named, of_the_valve(terms))

    def sliding(self, named: Named) -> Named:
        """``named`` as it was before the likelihood showed a stem that sticks again."""
        if named.sticks_again is None or self._sliding is None:
            return named
        return self._sliding
