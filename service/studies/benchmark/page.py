"""The page of a benchmark: what is asked, how answers are written and scored, and the digest."""

from __future__ import annotations

import re
from pathlib import Path

from stemwatch.service.studies.benchmark.answers import COLUMNS, MOST_CAUSES, cause_words
from stemwatch.service.studies.benchmark.draw import CASES_FILE, SAMPLES
from stemwatch.service.studies.benchmark.score import WRONG_CAUSE, WRONG_STICTION
from stemwatch.service.studies.benchmark.truth import NONE, STICKS_FROM

PAGE_FILE = "README.md"
_DIGEST = re.compile(r"^SHA-256 of the truth: `([0-9a-f]{64})`$", re.MULTILINE)
_PAGE = """# Does this valve stick, and why?

{cases} recordings of control loops, `case-0001.csv` and so on: {samples} samples at 1 s, in
percent, the time in UTC. OP is the controller output, MV the measured position of the
valve, PV the process variable, SP the set point. `Bad` is a sample without a value. Half of
the recordings have no MV. `{listing}` says of each which they are, whether its process
integrates (a level), and whether its cause is asked.

The loops are simulated by force balance, so that everything is known of them. Half of the
valves stick: S of {sticks_from:g} % or more, and no sound valve comes near. Some loops
oscillate because they stick, some for other reasons, some not at all.

## What is asked

1. **Does the valve stick?** `yes`, `no` or `cannot tell`, of every recording.
2. **S and J**, in percent of OP span, each with a 95 % interval. S is dead band plus stick
   band, J the slip jump, both as they read off the loop of MV over OP. Scored where the
   valve sticks, J only with MV.
3. **What else is wrong**, where `{listing}` asks: one word of the list below, or up to
   {most_causes} between which the recording leaves the choice, separated by `;`. An effect
   that is there moves the position by at least 0.15 % of span (RMS).

What cannot be told is left out: nothing is lost by it.

## Answers

One CSV file, separated by commas, with the heading

    {heading}

and one row a case. Every field but `case` may be empty, every column but `case` and every
row may be missing.

    case-0001,yes,4.2,3.1,5.0,1.9,1.2,2.6,{none}
    case-0002,cannot tell,,,,,,,

## The score

Five parts, each 1 for the truth and 0 for no answer; their mean is the total.
Whoever knows nothing gains nothing: the same answer to all cases, or one drawn by lot, has
no expected score above that of no answer.

| part | right | wrong | no answer |
|---|---|---|---|
| stiction, with position | 1 | {wrong_stiction:g} | 0 |
| stiction, without position | 1 | {wrong_stiction:g} | 0 |
| S; J | 1 - IS/B | the same | 0 |
| cause | 1 over the number of words | {wrong_cause:g} | 0 |

IS is the interval score of the 95 % interval (its width, and 40 times what the truth lies
outside: Gneiting and Raftery 2007, doi:10.1198/016214506000001437), B its mean for the best
interval that is the same for all cases. A value without an interval is shown in the table
and scores nothing.

    stemwatch benchmark judge FOLDER ANSWERS.csv --truth TRUTH.json

## The seal

SHA-256 of the truth: `{digest}`

The truth is a file that is not in this folder; who wrote the set may keep it. Before
anything is scored, its digest must be the one above, and the recordings must be those that
it was made with. A digest shows that the truth was not changed; it does not keep it secret
from whoever has the seed: `stemwatch benchmark write` with the same version and seed makes
the same set and truth, and small seeds can be tried one by one. A set that others are
judged by is written without `--seed`: a seed of 63 bits is then drawn, and stands in the
truth alone. Nothing else here tells of the truth: names are shuffled, and columns, length,
digits and process do not depend on it.

## The words for a cause

| word | meaning |
|---|---|
{causes}
"""


def page_of(cases: int, digest: str) -> str:
    """The page as Markdown."""
    causes = "\n".join(f"| `{word}` | {meaning} |" for word, meaning in cause_words().items())
    return _PAGE.format(
        cases=cases,
        digest=digest,
        samples=SAMPLES,
        listing=CASES_FILE,
        sticks_from=STICKS_FROM,
        heading=",".join(COLUMNS),
        most_causes=MOST_CAUSES,
        none=NONE,
        wrong_stiction=WRONG_STICTION,
        wrong_cause=WRONG_CAUSE,
        causes=causes,
    )


def digest_in(folder: Path) -> str:
    """The digest that the page of ``folder`` prints. Raises ``ValueError`` where there is none."""
    page = folder / PAGE_FILE
    found = _DIGEST.search(page.read_text(encoding="utf-8")) if page.is_file() else None
    if found is None:
        raise ValueError(
            f"{page}: found no line 'SHA-256 of the truth: ...'; expected the page that `stemwatch "
            "benchmark write` made"
        )
    return found[1]
