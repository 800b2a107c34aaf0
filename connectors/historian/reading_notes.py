"""What the reader decided and what it had to leave out, as sentences for the user."""

from __future__ import annotations

from dataclasses import dataclass, field

_LISTED = 20  # more problems of one file than this are counted, not listed


@dataclass
class ReadingNotes:
    """Collects sentences while one file is read, and which of the user's options were needed."""

    decisions: list[str] = field(default_factory=list)
    used: set[str] = field(default_factory=set)
    unused: dict[str, str] = field(default_factory=dict)  # the sentence about each such option
    _problems: list[str] = field(default_factory=list)
    _unlisted: int = 0

    def decide(self, sentence: str) -> None:
        if sentence not in self.decisions:
            self.decisions.append(sentence)

    def problem(self, sentence: str) -> None:
        if len(self._problems) < _LISTED:
            self._problems.append(sentence)
        else:
            self._unlisted += 1

    def use(self, option: str) -> None:
        """``option`` of ``ReadOptions`` was, or would have been, asked for."""
        self.used.add(option)

    def take(self, others: ReadingNotes) -> None:
        """Add what was noted elsewhere."""
        for sentence in others.decisions:
            self.decide(sentence)
        for sentence in others._problems:
            self.problem(sentence)
        self._unlisted += others._unlisted
        self.used |= others.used
        self.unused |= others.unused

    def not_used(self, option: str, sentence: str) -> None:
        """``option`` of ``ReadOptions`` was given and made no difference: a decision."""
        self.decide(sentence)
        self.unused[option] = sentence

    @property
    def problems(self) -> list[str]:
        """The first problems in file order, and how many more there are."""
        if not self._unlisted:
            return list(self._problems)
        return [*self._problems, f"and {self._unlisted} more of the same kind"]
