"""The terminal output of ``stemwatch explain``: finding, sentences, numbers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from stemwatch.models.estimate import Estimate
from stemwatch.models.mismatch.findings import Finding, Mismatch, Stiction
from stemwatch.models.words import counted
from stemwatch.service.cli import views
from stemwatch.service.explain.explain_recording import Explained
from stemwatch.service.presenter.finding import PresentedEffect, present_effects
from stemwatch.service.presenter.physics_words import (
    FINDING_SYMBOL,
    effect_name,
    effect_names,
    open_question_sentence,
)
from stemwatch.service.presenter.wording import (
    figure,
    finite,
    interval,
    not_yet_said,
    span_percent,
)
from stemwatch.service.report.mismatch_view import alternatives_of, how_both_ran, residual_bars

STYLE = {
    Finding.NAMED: "bold red",
    Finding.CANDIDATES: "yellow",
    Finding.UNKNOWN: "yellow",
    Finding.NONE: "green",
    Finding.NOT_TESTABLE: "cyan",
}
MOST_PLACES = 3  # places with the largest residual; the page shows all
INDENT = 2


def explanation(explained: Explained) -> RenderableType:
    """One valve: finding, places with the largest residual, effects with checks, numbers."""
    mismatch = explained.mismatch
    parts: list[RenderableType] = [Text.from_markup(_headline(explained))]
    if explained.signals_read:
        parts.append(_line(f"[dim]{views.escape(explained.signals_read)}[/]"))
    parts += [_line(text) for text in _sentences(mismatch)]
    if mismatch.finding is not Finding.NOT_TESTABLE:
        parts.append(Padding(_numbers(explained), (0, 0, 0, INDENT)))
    parts.append(Text(""))
    return Group(*parts)


def tally(valves: Sequence[Explained]) -> str:
    """The number of recordings with each finding, in one line."""
    counts = Counter(explained.mismatch.finding for explained in valves)
    words = [
        f"{counts[finding]} {effect_name(finding.value)}" for finding in Finding if counts[finding]
    ]
    return f"[bold]{counted(len(valves), 'recording')}:[/] {', '.join(words)}"


def _headline(explained: Explained) -> str:
    finding = explained.mismatch.finding
    word = f"[{STYLE[finding]}]{FINDING_SYMBOL[finding]} {effect_name(finding.value)}[/]"
    source = f"[dim]{views.escape(explained.source)}[/]"
    return f"{word}  [bold]{views.escape(explained.valve)}[/]  {source}"


def _line(markup: str) -> Padding:
    return Padding(Text.from_markup(markup), (0, 0, 0, INDENT))


def _sentences(mismatch: Mismatch) -> Iterator[str]:
    yield views.escape(mismatch.sentence)
    for record in mismatch.record_effects:
        name = effect_name(record.slug)
        yield f"[bold]In the record: {views.escape(name)}.[/] {views.escape(record.sentence)}"
    if mismatch.finding is not Finding.NONE:
        for cell in mismatch.before.hot[:MOST_PLACES]:
            yield f"[dim]Where[/]  {views.escape(cell.sentence)}"
    for effect in present_effects(mismatch):
        yield from _effect(effect, mismatch.sentence)
    if left_to_test := open_question_sentence(mismatch):
        yield f"[dim]Test[/]  {views.escape(left_to_test)}"
    if mismatch.not_testable:
        names = views.escape(effect_names(untestable.slug for untestable in mismatch.not_testable))
        yield f"[dim]Not testable here: {names}[/]"


def _effect(effect: PresentedEffect, finding_sentence: str) -> Iterator[str]:
    name = views.escape(effect.name.capitalize())
    sentence = " ".join(not_yet_said([effect.sentence], finding_sentence))
    yield f"[bold magenta]{name}[/]  {views.escape(sentence)}".rstrip()
    if effect.as_built:
        yield f"[bold]{views.escape(effect.as_built)}[/]"
    if effect.check:
        yield f"[dim]{effect.check_heading}[/]  {views.escape(effect.check)}"
    if effect.instead:
        yield f"[dim]Not told from[/]  {views.escape(f'{effect.instead}. {effect.decide}')}"
    yield f"[dim]Evidence[/]  {views.escape(effect.evidence)}"
    if effect.test is not None:
        test = f"{effect.test.do} Expected: {effect.test.fails}. Passes: {effect.passes}."
        yield f"[dim]Test in the field[/]  {views.escape(test)}"


def _numbers(explained: Explained) -> Table:
    """S, J and the fit on held-out samples, as on the page: first the values that count, then the
    alternatives. The fit of a long recording is that of the window shown."""
    table = Table(box=None, pad_edge=False)
    for name in ("", "S, %", "J, %", "fit, %", "rmse, %"):
        table.add_column(name, justify="right" if name else "left", no_wrap=bool(name))
    mismatch, by_window = explained.mismatch, explained.by_window
    heldout, counts = mismatch.heldout, mismatch.restated
    extended = heldout.fit_extended, heldout.rmse_extended
    of_valve = extended if by_window is None else (None, None)
    rows: list[tuple[str, Stiction, float | None, float | None]] = [
        ("of this valve", counts, *of_valve)
    ]
    for other in alternatives_of(mismatch, counts.S, counts.J, by_window):
        alone = other.stiction is mismatch.naive
        of_alone = (heldout.fit_naive, heldout.rmse_naive) if alone else (None, None)
        rows.append((f"not used: {other.of}", other.stiction, *of_alone))
    for name, stiction, fit, rmse in rows:
        table.add_row(name, _number(stiction.S), _number(stiction.J), figure(fit), figure(rmse, 2))
    table.caption = _caption(mismatch, shown_alone=by_window is not None) or None
    table.caption_justify = "left"
    return table


def _number(estimate: Estimate) -> str:
    if finite(estimate.value) is None:
        return "-"
    around = interval(estimate)
    return span_percent(estimate.value) + (f" ({around})" if around else "")


def _caption(mismatch: Mismatch, *, shown_alone: bool) -> str:
    """The interval of the gain, the network and the noise floor, as on the page; of a long
    recording first how what was named fits the window that is ``shown_alone``."""
    heldout, parts = mismatch.heldout, list[str]()
    if shown_alone and mismatch.effects:
        parts.append(f"with what was named the window shown fits {figure(heldout.fit_extended)} %")
    known = finite(heldout.gain_low) is not None and finite(heldout.gain_high) is not None
    if known and mismatch.effects:
        parts.append(
            f"fit grows by {figure(heldout.gain_low, 2)} to {figure(heldout.gain_high, 2)} "
            "percentage points"
        )
    if heldout.slip_by_slip or heldout.alternate_blocks:
        parts.append(how_both_ran(mismatch))
    bar_of_kind = {bar.kind: bar for bar in residual_bars(mismatch)}
    parts += [
        f"{bar_of_kind[kind].name} {figure(bar_of_kind[kind].rmse, 2)} %"
        for kind in ("narx", "floor")
        if kind in bar_of_kind
    ]
    return ", ".join(parts)
