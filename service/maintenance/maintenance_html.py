"""The maintenance report as HTML: one file that loads nothing, and prints one page per valve."""

from __future__ import annotations

from datetime import datetime
from functools import cache
from hashlib import sha256
from importlib.resources import files

from markupsafe import Markup

from stemwatch.service.maintenance.drawing import svg_of
from stemwatch.service.maintenance.work_list import WorkList
from stemwatch.service.presenter.advice import HINT, LEVEL_NAME
from stemwatch.service.presenter.urgency import CLASSES_IN_WORDS
from stemwatch.service.presenter.wording import NOTHING
from stemwatch.service.presenter.work_decision import verdict_before
from stemwatch.service.report.html_page import environment

TEMPLATE, STYLE = "maintenance.html", "maintenance.css"


def page_anchor(valve: str) -> str:
    """Where the page of ``valve`` begins: the same in every report, and one for each id."""
    return f"valve-{sha256(valve.encode('utf-8', 'surrogatepass')).hexdigest()[:16]}"


def work_list_html(work_list: WorkList) -> bytes:
    """The page as UTF-8. There is no script in it, and its policy allows none."""
    env = environment(work_list.context, _resource)

    def day(moment: datetime | None) -> str:
        return NOTHING if moment is None else f"{moment.astimezone(work_list.context.tz):%Y-%m-%d}"

    env.filters["day"] = day
    env.filters["verdict_before"] = verdict_before
    env.filters["page_anchor"] = page_anchor
    text = env.get_template(TEMPLATE).render(
        work_list=work_list,
        context=work_list.context,
        run=work_list.run,
        pictures=[
            Markup("") if sheet.picture is None else svg_of(sheet.picture)
            for sheet in work_list.sheets
        ],
        drawn=[
            None if compared.drawing is None else svg_of(compared.drawing)
            for compared in work_list.done
        ],
        levels=LEVEL_NAME,
        hint=HINT,
        priorities=CLASSES_IN_WORDS,
        styles=Markup(_resource(STYLE)),
    )
    return text.encode()


@cache
def _resource(name: str) -> str:
    return files("stemwatch.service.maintenance").joinpath(name).read_text("utf-8")
