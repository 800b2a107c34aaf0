"""Windows of a browser, which tests use one after the other.

A new window takes most of a second of processor time, for a process of its own. So a test is given
one that an earlier test is done with, and finds it as a new one would be.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

DESK = {"width": 1280, "height": 720}
FORGET = "() => { try { localStorage.clear(); sessionStorage.clear(); } catch (_) {} }"


class _Window:
    """A page, and the lists of the test that has it: what was logged, and what was asked for."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.logged: list[str] = []
        self.asked: list[str] = []
        page.on("console", lambda message: self.logged.append(message.text))
        page.on("pageerror", lambda error: self.logged.append(str(error)))
        page.on("dialog", self._dismiss)
        page.on("request", lambda request: self.asked.append(request.url))

    def _dismiss(self, dialog: Any) -> None:
        self.logged.append(dialog.message)
        dialog.dismiss()

    def clear(self) -> None:
        """Leave the page, and forget what it stored."""
        self.logged, self.asked = [], []
        self.page.context.set_offline(False)
        self.page.evaluate(FORGET)
        self.page.goto("about:blank")
        self.page.context.clear_cookies()


class Windows:
    """The windows of one browser."""

    def __init__(self, browser: Any) -> None:
        self._browser = browser
        self._idle: dict[bool, list[_Window]] = {True: [], False: []}  # whether scripts run
        self._lent: list[tuple[bool, _Window]] = []

    def open(
        self,
        url: str,
        *,
        cookies: Iterable[dict[str, str]] = (),
        logged: list[str] | None = None,
        asked: list[str] | None = None,
        viewport: dict[str, int] = DESK,
        color_scheme: str = "light",
        offline: bool = False,
        java_script_enabled: bool = True,
    ) -> Any:
        """The page of ``url``. What it logs and whatever it asks for go onto the lists, until
        ``close``."""
        idle = self._idle[java_script_enabled]
        window = idle.pop() if idle else self._new(java_script_enabled)
        self._lent.append((java_script_enabled, window))
        window.logged = [] if logged is None else logged
        window.asked = [] if asked is None else asked
        window.page.set_viewport_size(viewport)
        window.page.emulate_media(media="null", color_scheme=color_scheme)
        window.page.context.set_offline(offline)
        window.page.context.add_cookies(list(cookies))
        window.page.goto(url)
        return window.page

    def close(self) -> None:
        """Take back every window."""
        while self._lent:
            scripts, window = self._lent.pop()
            window.clear()
            self._idle[scripts].append(window)

    def _new(self, scripts: bool) -> _Window:
        return _Window(self._browser.new_context(java_script_enabled=scripts).new_page())


def colours_drawn(page: Any, selector: str) -> int:
    """How many different colours the canvas inside ``selector`` shows."""
    colours: int = page.locator(f"{selector} canvas").first.evaluate(
        """canvas => {
            const area = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            return new Set(new Uint32Array(area.data.buffer)).size;
        }"""
    )
    return colours
