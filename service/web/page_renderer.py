"""``PageRenderer``: fills the templates of the pages and of the report, with what every page shows
around them."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from typing import Any
from urllib.parse import urlencode

from fastapi import Request
from fastapi.responses import HTMLResponse

from stemwatch.service.access.sessions import form_token_of
from stemwatch.service.presenter.alert_history import S_since_raised, kind_words, opened_again
from stemwatch.service.report.html_page import environment
from stemwatch.service.report.report_context import ReportContext, software_name
from stemwatch.service.web import assets
from stemwatch.service.web.auth import forms
from stemwatch.service.web.auth.current_user import current_user_of, may
from stemwatch.service.web.auth.proxy_user import HOW
from stemwatch.service.web.path_prefix import root_of
from stemwatch.service.web.site import Site

PAGES = (
    ("overview", "/overview", "Overview"),
    ("ranking", "/", "Valves"),
    ("oscillations", "/oscillations", "Oscillations"),
    ("alerts", "/alerts", "Alerts"),
    ("runs", "/runs", "Runs"),
    ("sources", "/sources", "Sources"),
    ("settings", "/settings", "Settings"),
)


# Messages after an action. The address holds only the key, so that a link cannot put text into a
# page.
DONE = {
    "acknowledged": "The alert is acknowledged.",
    "snoozed": "The alert is snoozed until the time you gave.",
    "false": "The alert is marked as a false alarm.",
    "all-acknowledged": "The alerts that were on the page are acknowledged.",
    "all-snoozed": "The alerts that were on the page are snoozed until the time you gave.",
    "all-false": "The alerts that were on the page are marked as false alarms.",
    "note": "The note is kept.",
    "feedback": "What was found is kept, beside what had been said.",
    "maintenance": "The work is recorded. The first window after it becomes the new baseline.",
    "baseline": "The network fitted last is the valve's baseline now.",
    "run": "The run is asked for.",
    "cancel": "The run is asked to end early; what is done stays.",
    "limits": "The limits are set; the next run goes by them.",
    "schedule": "The schedule is set; it holds from now on.",
    "unscheduled": "The schedule is removed.",
    "password": "Your password is changed. Every other browser is signed out.",
    "sessions": "Every other browser is signed out.",
    "revoked": "The token lets nobody in any more.",
    "role": "The role is changed; it holds from now on.",
    "disabled": "The user is disabled: signed out everywhere, tokens and links at rest.",
    "enabled": "The user may sign in again.",
    "withdrawn": "The link lets nobody in any more.",
}


class PageRenderer:
    """Renders pages. Every text from outside is escaped by the report's environment."""

    def __init__(self, site: Site) -> None:
        self._site = site
        context = ReportContext(started=site.clock(), zone=site.zone, plant=site.name)
        self._env = environment(context, _template)
        self._env.globals |= {
            "asset": assets.address,
            "context": context,
            "nav": PAGES,
            "kind_words": kind_words,
            "opened_again": lambda alert: opened_again(alert.evidence, site.tz, site.zone),
            "S_since_raised": lambda alert: S_since_raised(alert.evidence),
            "site": site,
            "software": software_name(),
            "valve_link": valve_link,
            "query": lambda **fields: urlencode(fields, doseq=True),
        }

    def page(
        self, request: Request, template: str, *, status: int = 200, **values: Any
    ) -> HTMLResponse:
        """``template`` with ``values``, who reads it, the token of its forms, and the place of the
        site. Without a session the token belongs to a cookie of its own."""
        current_user = current_user_of(request)
        # Users signed in by a proxy have no session: their forms have a cookie of their own.
        by_form = current_user is None or current_user.signed_in_by == HOW
        cookie = forms.cookie_of(request) if by_form else ""
        text = self._env.get_template(template).render(
            base=root_of(request.scope),
            form_token=form_token_of(cookie)
            if by_form or current_user is None
            else current_user.form_token,
            current_user=current_user,
            may=lambda name: may(current_user, name),
            now=self._site.clock(),
            done=DONE.get(request.query_params.get("done", ""), ""),
            **{"here": "", "open_alerts": 0} | values,
        )
        response = HTMLResponse(text, status)
        if cookie:
            forms.set_cookie(response, cookie, request.scope)
        return response


def valve_link(valve: str) -> str:
    """Where a valve's page is, below the root of the site.

    In the query and not in the path: a tag may be ``..`` or hold slashes, which browsers and
    proxies rewrite in paths.
    """
    return f"/valve?{urlencode({'id': valve})}"


@cache
def _template(name: str) -> str:
    """A template of this package, of the report or of the planned test."""
    for folder in ("web/templates", "report/templates", "field_test"):
        resource = files("stemwatch.service").joinpath(folder, name)
        if resource.is_file():
            return resource.read_text("utf-8")
    raise FileNotFoundError(f"no template {name}")
