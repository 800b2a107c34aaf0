"""Output in the terminal that all commands share: messages, progress, and text that is safe to
print."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape as _escape_markup
from rich.progress import Progress
from rich.table import Table

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from stemwatch.service.config import Plant
    from stemwatch.service.report import ReportContext
    from stemwatch.service.studies.miswiring import WiringAnswer
    from stemwatch.service.studies.robustness import StudyAnswer
    from stemwatch.service.studies.without_position.count import StudiedLoop

out = Console()
err = Console(stderr=True)
WIDE = 130  # columns of a terminal from which a table has room for sentences

# Control characters, and the format characters that reverse or hide letters.
_UNPRINTABLE = re.compile(
    "[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]"
)


def escape(text: str) -> str:
    """``text`` without markup and without control characters for the terminal."""
    return _escape_markup(_UNPRINTABLE.sub("\N{REPLACEMENT CHARACTER}", text))


def as_toml_escapes(text: str) -> str:
    """TOML with control characters and invisible letters written as escapes."""
    return _UNPRINTABLE.sub(lambda match: f"\\U{ord(match[0]):08x}", text)


def say_error(text: str) -> None:
    """Print an error to standard error."""
    err.print(f"[bold red]stemwatch:[/] {escape(text)}", highlight=False)


def say(text: str) -> None:
    """Print a line of progress to standard error."""
    err.print(escape(text), highlight=False)


def say_if_not_blind(seed: int) -> None:
    """Say so where valves of this seed were looked at while the method was made."""
    from stemwatch.service.studies.seeds import DEVELOPED_WITH

    if seed in DEVELOPED_WITH:
        say(f"Seed {seed} was looked at while the method was made: this is not blind.")


def write_file(path: Path, content: str | bytes) -> None:
    """Write a file that an option names: replaced whole, or left as it was.

    Raises ``ReportNotWritten`` with the file and what to do.
    """
    from stemwatch.service.whole_files import put_all

    written = content.encode() if isinstance(content, str) else content
    if path.exists() and not path.is_file():  # /dev/stdout, a pipe
        path.write_bytes(written)
    else:
        put_all({path.resolve(): written})


def write_json(path: Path, value: Any, *, allow_nan: bool = False) -> None:
    """Write ``value`` as JSON, as ``write_file`` does. Raises ``ValueError`` where it holds a
    number that is not finite, unless ``allow_nan``."""
    text = json.dumps(value, allow_nan=allow_nan, ensure_ascii=False, indent=1)
    write_file(path, text + "\n")


def write_answers(
    answers: Sequence[WiringAnswer] | Sequence[StudyAnswer] | Sequence[StudiedLoop],
    json_file: Path | None,
) -> None:
    """The answers of a study, dataclasses with a ``verdict``, as JSON, where a file is named."""
    if json_file is not None:
        objects = [{**asdict(answer), "verdict": answer.verdict.value} for answer in answers]
        write_json(json_file, objects, allow_nan=True)


def say_next(text: str) -> None:
    """Print what to do next, to standard error, so that programs that read the output are not
    disturbed."""
    err.print(f"[bold]Next:[/] {escape(text)}", highlight=False, soft_wrap=True)


def say_read_on(page: str) -> None:
    """Print where the counts of a study are explained, and what to do with valves of one's own."""
    say_next(
        f"docs/{page} says what was simulated and how to read these figures; valves of your own: "
        "`stemwatch screen FILE`."
    )


def say_result(text: str) -> None:
    """Print a line of the result to standard output."""
    out.print(escape(text), highlight=False)


def plain_table(title: str, left_columns: Sequence[str], right: Sequence[str]) -> Table:
    """A table without frames, so that numbers fit into eighty columns uncut."""
    table = Table(
        title=title,
        title_justify="left",
        box=SIMPLE_HEAD,
        padding=0,
        pad_edge=False,
        show_edge=False,
    )
    for name in left_columns:
        table.add_column(name, overflow="fold")
    for name in right:
        table.add_column(name, justify="right", no_wrap=True)
    return table


def page_context(title: str, plant: Plant | None, zone: str) -> ReportContext:
    """The context of a page: its title, the plant's name, and times in the plant's zone, else in
    ``zone``, else UTC."""
    from stemwatch.connectors.secret import masked_command
    from stemwatch.service.report import ReportContext

    return ReportContext(
        started=datetime.now(UTC),
        title=title,
        plant=plant.name if plant else "",
        zone=(plant.zone if plant else None) or zone or "UTC",
        command=masked_command(("stemwatch", *sys.argv[1:])),
    )


@contextmanager
def progress(
    description: str, total: int, *, transient: bool = False
) -> Iterator[Callable[[int], None]]:
    """A progress bar; yields a function that is called with how many of ``total`` are done. A
    transient bar is removed at its end."""
    with Progress(console=err, transient=transient) as bars:
        bar = bars.add_task(description, total=total)
        yield lambda items_done: bars.update(bar, completed=items_done)
