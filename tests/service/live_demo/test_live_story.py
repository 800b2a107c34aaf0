"""The story of the live demo in a real browser: a valve wears, is reported, repaired, and better.

With ``STEMWATCH_PICTURES=1`` the pages on the way are kept in ``docs/pictures``.
"""

from __future__ import annotations

import io
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stemwatch.service.live_demo.loops import WEARING, live_loops
from tests.service.live_demo.running_demo import Started

pytestmark = [pytest.mark.browser, pytest.mark.long, pytest.mark.early]

DESK = {"width": 1280, "height": 900}
PHONE = {"width": 390, "height": 844}
PICTURES = Path(__file__).parents[3] / "docs" / "pictures"
KEEP = os.environ.get("STEMWATCH_PICTURES") == "1"
PASSWORD = "not to be used outside of this test"
WHO, COMMENT, WORK = "K. Berg", "the packing is ordered", "packing renewed"


class Reader:
    """Somebody at a browser who has signed in to the demo's pages."""

    def __init__(self, browser: Any, started: Started) -> None:
        self.base = started.said(r"^Serving (http://\S+/)")[1]
        self._browser = browser
        self._context = browser.new_context(viewport=DESK, color_scheme="light")
        self.page = self._context.new_page()
        sign_in(self.page, self.base, started)

    def open(self, path: str) -> None:
        """Go to a page."""
        self.page.goto(self.base + path)

    def open_valve(self) -> None:
        """Go to the page of the valve that wears."""
        self.open(f"valve?id={WEARING}")

    def ask(self, path: str) -> Any:
        """What the API answers."""
        answer = self._context.request.get(f"{self.base}api/v1/{path}")
        assert answer.ok, answer.text()
        return answer.json()

    def keep(self, name: str, *, dark: bool = False, phone: bool = False, at: str = "") -> None:
        """A picture of the page as it is, where pictures are asked for; ``at`` is what stands at
        its top."""
        if not KEEP:
            return
        page = self.page
        page.emulate_media(color_scheme="dark" if dark else "light")
        page.set_viewport_size(PHONE if phone else DESK)
        page.evaluate("scrollTo(0, 0)")  # a reload keeps the place
        page.reload()
        page.wait_for_load_state("networkidle")
        page.wait_for_timeout(1000)
        if at:
            page.locator(at).first.evaluate("one => one.scrollIntoView()")
        page.wait_for_timeout(300)
        save(page.screenshot(), PICTURES / f"live-{name}.png")
        page.emulate_media(color_scheme="light")
        page.set_viewport_size(DESK)

    def close(self) -> None:
        """Close the window."""
        self._context.close()


def sign_in(page: Any, base: str, started: Started) -> None:
    """Open the pages as the first user, by the one-time link that the service printed."""
    page.goto(started.said(r"(http://\S+/welcome\?\S+)")[1])
    page.locator('input[name="name"]').fill(WHO)
    for field in page.locator('input[type="password"]').all():
        field.fill(PASSWORD)
    page.get_by_role("button", name="Begin").click()
    page.wait_for_url(base)


def save(picture: bytes, file: Path) -> None:
    """Keep a picture with 256 colours, which text and lines are content with."""
    from PIL import Image

    file.parent.mkdir(exist_ok=True)
    with Image.open(io.BytesIO(picture)) as full:
        full.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(file, optimize=True)


def until(there: Callable[[], Any], seconds: float, started: Started, what: str) -> Any:
    """What ``there`` gives as soon as it gives something."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if result := there():
            return result
        time.sleep(0.5)
    return pytest.fail(f"{what} did not come:\n{started.everything()}")


@pytest.fixture
def reader(browser: Any, started: Started) -> Any:
    """Somebody who looks at the demo."""
    result = Reader(browser, started)
    yield result
    result.close()


def judged(reader: Reader, verdict: str) -> list[dict[str, Any]]:
    """The screenings of the wearing valve with this verdict, oldest first."""
    points: list[dict[str, Any]] = reader.ask(f"valve/history?id={WEARING}")["points"]
    matching = [point for point in points if point["verdict"] == verdict]
    return sorted(matching, key=lambda point: point["at"])


def marks(reader: Reader, kind: str) -> list[dict[str, Any]]:
    """What was noted of the wearing valve, of this kind."""
    result = reader.ask(f"valve/history?id={WEARING}")["marks"]
    return [mark for mark in result if mark["kind"] == kind]


def fill_in(form: Any, text: str) -> None:
    """A form's text, and the name where it asks for one."""
    form.locator('input[name="text"]').fill(text)
    name = form.locator('input[name="who"]')
    if name.count():
        name.fill(WHO)


def test_a_valve_wears_is_reported_repaired_and_better(started: Started, reader: Reader) -> None:
    """Healthy, then sticky; the mail comes, the alert is acknowledged, the work recorded, and a
    run over what came after says that it helped. Nothing is said against the other valves."""
    until(lambda: judged(reader, "healthy"), 180, started, "a verdict on the new valve")
    reader.open_valve()
    reader.keep("1-healthy")
    the_alert_comes(started, reader)
    the_mail_is_there(started, reader)
    somebody_acknowledges(reader)
    the_work_is_recorded(started, reader)
    it_helped(started, reader)
    every = reader.ask("alerts?state=all")
    assert {alert["valve"] for alert in every} == {WEARING}, every
    others = {loop.tag for loop in live_loops()} - {WEARING}
    ranked = {line["valve"]: line for line in reader.ask("valves")["valves"]}
    assert {ranked[tag]["verdict"] for tag in others} <= {"healthy", "undetermined"}
    assert started.stop() == 0, started.everything()
    assert "Traceback" not in started.everything()


def the_alert_comes(started: Started, reader: Reader) -> None:
    """S grows from screening to screening until the rule of N of M runs raises the alert."""

    def sticky() -> list[dict[str, Any]]:
        return [item for item in reader.ask("alerts") if item["kind"] == "sticky"]

    (alert,) = until(sticky, 300, started, "the alert")
    assert alert["valve"] == WEARING
    assert alert["severity"] == "high"
    healthy, worn = judged(reader, "healthy")[0], judged(reader, "sticky")
    assert len(worn) >= 2
    assert worn[-1]["S_low"] > healthy["S_high"]


def the_mail_is_there(started: Started, reader: Reader) -> None:
    """In the catcher's list, and as a file that a mail program reads."""
    result = started.said(r"^A mail arrived \((\d+\.eml)\): .*" + WEARING, 120)
    assert WEARING in (started.folder / "mails" / result[1]).read_text("utf-8")
    until(
        lambda: _mails_with("The stem sticks", started), 120, started, "the mail about the stiction"
    )
    reader.page.goto((started.folder / "mails" / "index.html").as_uri())
    assert "The stem sticks" in reader.page.locator("ol").inner_text()
    reader.keep("3-mail")


def _mails_with(words: str, started: Started) -> list[Path]:
    mails = (started.folder / "mails").glob("*.eml")
    return [mail for mail in mails if words in mail.read_text("utf-8").replace("=\n", "")]


def somebody_acknowledges(reader: Reader) -> None:
    """On the page of alerts, with a comment."""
    reader.open("alerts")
    reader.keep("2-alert")
    reader.keep("2-alert-phone", phone=True)
    card = reader.page.locator(".card", has_text="The stem sticks").first
    card.locator("summary").click()
    fill_in(card, COMMENT)
    card.get_by_role("button", name="Acknowledge").click()
    reader.page.get_by_text("The alert is acknowledged.").wait_for()
    (alert,) = [
        item for item in reader.ask("alerts?state=acknowledged") if item["kind"] == "sticky"
    ]
    assert alert["comment"] == COMMENT


def the_work_is_recorded(started: Started, reader: Reader) -> None:
    """On the valve's page; the simulated valve is repaired for it."""
    reader.open_valve()
    reader.keep("4-sticky")
    reader.keep("4-sticky-dark", dark=True, at="#signals")
    reader.keep("4-sticky-phone", phone=True)
    page = reader.page
    page.locator("summary", has_text="Record maintenance").click()
    form = page.locator('form[action$="/valve/maintenance"]')
    fill_in(form, WORK)
    form.get_by_role("button", name="Record the work").click()
    started.said(f"{WEARING} has been repaired", 30)
    assert [mark["text"] for mark in marks(reader, "maintenance")] == [WORK]


def it_helped(started: Started, reader: Reader) -> None:
    """The note names both intervals, and they do not meet."""

    def said() -> list[dict[str, Any]]:
        return [mark for mark in marks(reader, "note") if WORK in mark["text"]]

    (note,) = until(said, 240, started, "the comparison of before and after")
    assert "It helped" in note["text"], note["text"]
    before, after = judged(reader, "sticky")[-1], judged(reader, "healthy")[-1]
    assert after["S_high"] < before["S_low"]
    reader.open_valve()
    assert "It helped" in reader.page.locator(".log").inner_text()
    reader.keep("5-better", at="#months")
    reader.keep("5-better-dark", dark=True)
    reader.keep("5-better-phone", phone=True, at="#log")
    reader.open("")
    reader.keep("6-ranking")
