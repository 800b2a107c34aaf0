"""The report page: one HTML file with its styles, scripts and data inside, which loads nothing.

A content security policy allows exactly the scripts in it, by their digest, and no request at all,
so that neither a tag's spelling nor a reader's network can change the page.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from itertools import islice
from typing import Any, BinaryIO

from jinja2 import BytecodeCache, Environment, FunctionLoader, StrictUndefined
from jinja2.bccache import Bucket
from markupsafe import Markup, escape

from stemwatch.service.plant_path import names_by_level
from stemwatch.service.presenter import oscillation_words
from stemwatch.service.presenter import physics_words as mismatch_words
from stemwatch.service.presenter import wording as words
from stemwatch.service.presenter.cost_of_sticking import MADE_BY_STICKING
from stemwatch.service.presenter.finding import present_effect
from stemwatch.service.presenter.response_table import response_table
from stemwatch.service.presenter.suspicion_words import (
    HOW_SURE,
    NO_SIGN_NOTE,
    SUSPECTED_NOTE,
    answers_sentence,
    loops_to_test,
    loops_without_sign,
    suspicion_title,
)
from stemwatch.service.presenter.urgency import CLASSES_IN_WORDS
from stemwatch.service.report.bars import MODEL_NAMES, fit_bars, gauge, gauge_top, spread_percent
from stemwatch.service.report.charts.traces import Chart
from stemwatch.service.report.charts.valve_plots import ValvePlots, plots_of
from stemwatch.service.report.evidence_by_window import evidence_picture
from stemwatch.service.report.group_pictures import spectra_map, strength_bars
from stemwatch.service.report.histogram_table import histogram_table
from stemwatch.service.report.mismatch_view import (
    MismatchView,
    gain_rows,
    how_both_ran,
    mismatch_view,
    rejected_rows,
    residual_bars,
)
from stemwatch.service.report.ranking import RankedValve, Ranking
from stemwatch.service.report.report_context import ReportContext

# Of a plant of a thousand valves the page has to open on a laptop, over the plant's network: below
# 10 MB. A section in full, with plots and numbers, is some 120 KB; one in words 6 KB; what comes
# after is a row of the table, 1.6 KB.
MOST_PLOTTED = 40
MOST_SECTIONS = 400
NOTHING_DRAWN = ValvePlots(chart=None, overlay=None)

STYLES = (
    "scripts/vendor/uPlot.min.css",
    "styles/report.css",
    "styles/mismatch.css",
    "styles/print.css",
)
EARLY_SCRIPTS = ("scripts/theme.js",)
PLOT_SCRIPTS = (
    "scripts/vendor/uPlot.iife.min.js",
    "scripts/axes.js",
    "scripts/data.js",
    "scripts/charts.js",
    "scripts/loop.js",
    "scripts/overview.js",
    "scripts/plots.js",
)
SCRIPTS = ("scripts/ranking.js", *PLOT_SCRIPTS)


@dataclass(frozen=True, kw_only=True)
class PlottedValve:
    """A ranked valve with what its plots draw; ``why_not`` says why there are none. ``in_full``:
    with the numbers behind the finding."""

    valve: RankedValve
    chart: Chart | None
    why_not: str
    mismatch: MismatchView | None = None
    in_full: bool = True


def write_html(ranked: Ranking, context: ReportContext, file: BinaryIO) -> None:
    """The page as UTF-8, valve by valve."""
    for piece in _pieces(ranked, context):
        file.write(piece.encode())


def html_bytes(ranked: Ranking, context: ReportContext) -> bytes:
    """The page as UTF-8."""
    return "".join(_pieces(ranked, context)).encode()


def _pieces(ranked: Ranking, context: ReportContext) -> Iterator[str]:
    next_steps = ranked.next_steps
    page = environment(context, template).get_template("report.html")
    return page.generate(
        context=context,
        counts=ranked.recordings_of,
        work=ranked.counts,
        ranked=ranked,
        valves=_plotted(ranked),
        discovered=ranked.discovered.sentence,
        told=MOST_SECTIONS,
        priorities=CLASSES_IN_WORDS,
        suspected=answers_sentence(next_steps),
        note_of=dict.fromkeys(loops_to_test(next_steps), SUSPECTED_NOTE)
        | dict.fromkeys(loops_without_sign(next_steps), NO_SIGN_NOTE),
        next_steps=next_steps,
        cost=ranked.cost_of_sticking,
        summary=ranked.summary,
        levels=names_by_level(context.valves.values()),
        units=ranked.units,
        gauge_top=gauge_top(valve.screening for valve in ranked),
        models=MODEL_NAMES,
        compact=True,
        **inlined(SCRIPTS),
    )


def _plotted(ranked: Sequence[RankedValve]) -> Iterator[PlottedValve]:
    return (_plot(valve) for valve in islice(ranked, MOST_SECTIONS))


def _plot(valve: RankedValve) -> PlottedValve:
    in_full = valve.rank <= MOST_PLOTTED
    evidence = (valve.evidence or plots_of(valve.screening)) if in_full else NOTHING_DRAWN
    if not in_full:
        reason = (
            f"Plots are kept for the first {MOST_PLOTTED} valves of the ranking, and so are the "
            "numbers behind them, so that the page stays small: valves.xlsx and valves.json have "
            "the numbers of every valve, and a report of this valve alone shows its plots."
        )
    else:
        no_samples = "There is nothing to plot: no samples could be read."
        reason = no_samples if evidence.chart is None else ""
    mismatch = _view(valve, evidence, in_words=not in_full)
    return PlottedValve(
        valve=valve, chart=evidence.chart, why_not=reason, mismatch=mismatch, in_full=in_full
    )


def _view(valve: RankedValve, evidence: ValvePlots, *, in_words: bool) -> MismatchView | None:
    mismatch, tag = valve.screening.mismatch, valve.screening.valve
    if mismatch is None:
        return None
    return mismatch_view(
        mismatch,
        None,
        valve.anchor,
        tag,
        valve.finding.held_back,
        overlay=evidence.overlay,
        counts=(valve.screening.S, valve.screening.J),
        pictures=evidence.pictures.effects,
        in_words=in_words,
    )


class _Compiled(BytecodeCache):
    """The templates compiled in this process: each page has an environment of its own, and
    compiling takes longer than rendering most pages. A changed template is compiled again."""

    def __init__(self) -> None:
        self._code: dict[str, bytes] = {}

    def load_bytecode(self, bucket: Bucket) -> None:
        if bucket.key in self._code:
            bucket.bytecode_from_string(self._code[bucket.key])

    def dump_bytecode(self, bucket: Bucket) -> None:
        self._code[bucket.key] = bucket.bytecode_to_string()


_COMPILED = _Compiled()


def environment(context: ReportContext, load: Callable[[str], str]) -> Environment:
    """Templates by the names that ``load`` knows; every text from outside is escaped."""
    env = Environment(
        loader=FunctionLoader(load),
        bytecode_cache=_COMPILED,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=_finalize,
    )
    env.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    env.filters |= {
        "figure": words.figure,
        "group_headline": oscillation_words.headline,
        "group_cost": oscillation_words.cost_sentence,
        "group_begun": lambda group: oscillation_words.begin_clause(group, context.tz),
        "group_seen": oscillation_words.seen_sentence,
        "oscillates_with": lambda loop: oscillation_words.loop_sentences(
            context.groups, loop, context.tz
        ),
        "spectra_map": spectra_map,
        "strength_bars": lambda group: strength_bars(group, context.tz),
        "span_percent": words.span_percent,
        "share": words.share,
        "interval": words.interval,
        "duration": words.duration,
        "finite": words.finite,
        "gauge": gauge,
        "fit_bars": fit_bars,
        "spread_percent": spread_percent,
        "residual_bars": residual_bars,
        "how_both_ran": how_both_ran,
        "gain_rows": gain_rows,
        "rejected_rows": rejected_rows,
        "effect_name": mismatch_words.effect_name,
        "parameter_name": mismatch_words.parameter_name,
        "record_parameter": mismatch_words.record_parameter,
        "no_limit": mismatch_words.no_limit,
        "effect_names": mismatch_words.effect_names,
        "open_question_sentence": mismatch_words.open_question_sentence,
        "finding_symbol": lambda finding: mismatch_words.FINDING_SYMBOL[finding],
        "finding_title": mismatch_words.finding_title,
        "finding_meaning": lambda finding: mismatch_words.FINDING_MEANING[finding],
        "not_yet_said": words.not_yet_said,
        "as_sentences": words.as_sentences,
        "after_work": words.after_work,
        "from_the_twin": lambda indicators: any(name in indicators for name in MADE_BY_STICKING),
        "response_table": response_table,
        "histogram_table": histogram_table,
        "presented": present_effect,
        "evidence_picture": lambda of_weeks: evidence_picture(of_weeks, context.tz),
        "evidence_sentences": lambda of_weeks: of_weeks.sentences(context.tz),
        "sortable": words.sortable,
        "plain": "{:g}".format,
        "prose": prose_in_html,
        "instant": lambda when: words.instant(when, context.tz),
        "window": lambda ends: words.window(ends[0], ends[1], context.tz, context.zone),
        "suspicion_title": suspicion_title,
        "how_sure": lambda _: HOW_SURE,
        "symbol": lambda verdict: words.VERDICT_SYMBOL[verdict],
        "verdict_meaning": lambda verdict: words.VERDICT_MEANING[verdict],
    }
    return env


def prose_in_html(text: str) -> Markup:
    """A sentence of ``prose`` as HTML: its commands set as code, everything else escaped."""
    return Markup(words.COMMAND.sub(r"<code>\1</code>", str(escape(words.prose(text)))))


def _finalize(value: Any) -> Any:
    # Markup comes from our templates; every other text may contain characters that HTML does not
    # allow.
    if isinstance(value, str) and not isinstance(value, Markup):
        return words.printable(value)
    return value


def template(name: str) -> str:
    """The text of a template of the report, such as ``valve.html``."""
    return resource(f"templates/{name}")


@cache
def resource(name: str) -> str:
    """The text of a file of this package, such as ``styles/report.css``."""
    return files("stemwatch.service.report").joinpath(name).read_text("utf-8")


@cache
def inlined(scripts: tuple[str, ...]) -> dict[str, Any]:
    """What a page holds of styles and ``scripts``, and the policy that allows no others."""
    early = _script(EARLY_SCRIPTS)
    late = _script(scripts)
    return {
        "styles": Markup("\n".join(resource(name) for name in STYLES)),
        "early_script": early,
        "script": late,
        "policy": script_policy(early, late),
        "chart_licence": resource("scripts/vendor/uPlot-LICENSE.txt"),
    }


def _script(names: Sequence[str]) -> Markup:
    return Markup(";\n".join(resource(name).strip() for name in names))


def script_policy(*scripts: str) -> str:
    """A page's policy, which allows these scripts and nothing that is loaded."""
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    allowed = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; "
        "base-uri 'none'; form-action 'none'"
    )
