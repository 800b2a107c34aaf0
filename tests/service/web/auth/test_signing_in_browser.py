"""Login, account, users, tokens and audit log in a real browser: by keyboard and on a phone."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from stemwatch.service.access.links import first_link
from stemwatch.service.store.accounts.records import AuditEntry, AuditOutcome, Scope, UserRole
from stemwatch.service.web.site import Site
from tests.service.example_user import make_user
from tests.service.web.example_plant import HOSTILE, NOW, STICKY, serving
from tests.service.web.pages.test_pages_browser import DESK, PHONE, Opened, valve_path
from tests.service.web.signed_in import NAMES, PASSWORD, bearer_of, cookie_of, user_of

pytestmark = pytest.mark.browser

ADMIN_PAGES = ("/account", "/users", "/tokens", "/audit")


@pytest.fixture
def peopled(live: Site) -> Site:
    """The small plant with users of every role, a token, and a log with odd words in it."""
    for role in UserRole:
        user_of(live, role)
    bearer_of(live, UserRole.ENGINEER, (Scope.READ,))
    for outcome in AuditOutcome:
        live.store.audit.add(
            AuditEntry(
                at=NOW,
                who=NAMES[UserRole.ENGINEER],
                how="session",
                address="2001:db8:aaaa:bbbb:cccc:dddd:eeee:ffff",
                action="add a note",
                about=f"valve {HOSTILE}",
                outcome=outcome,
            )
        )
    return live


@pytest.fixture
def opened(windows, peopled: Site) -> Iterator[Opened]:
    """A browser in which the admin is signed in; at the end nothing was logged."""
    with serving(peopled) as base:
        at = Opened(windows, base, cookie_of(peopled))
        yield at
        at.close()
    assert at.errors == []
    assert at.foreign == []


def test_somebody_signs_in_by_keyboard_and_out_again(windows, live: Site) -> None:
    """The page that was wanted comes after the login; after signing out nothing is left."""
    make_user(live.store, "Ann", PASSWORD, UserRole.ENGINEER)
    with serving(live) as base:
        at = Opened(windows, base)
        page = at.page(valve_path(STICKY))
        assert page.evaluate("document.activeElement.name") == "name"
        page.keyboard.type("Ann")
        page.keyboard.press("Tab")
        page.keyboard.type(PASSWORD)
        page.keyboard.press("Enter")
        page.locator("h1", has_text=STICKY).wait_for()
        page.get_by_role("button", name="Sign out", exact=True).click()
        page.get_by_role("heading", name="Sign in").wait_for()
        page.go_back()
        page.get_by_role("heading", name="Sign in").wait_for()
        at.close()
    assert at.foreign == []
    assert [error for error in at.errors if "401" not in error] == []


def test_the_first_admin_arrives_by_the_printed_link(windows, store) -> None:
    """Name, password twice, and the pages are there."""
    site = Site(store=store)
    with serving(site) as base:
        at = Opened(windows, base)
        page = at.page(first_link(store, base).removeprefix(base))
        page.get_by_label("Your name").fill("Karl Berg")
        page.get_by_label("Password", exact=True).fill(PASSWORD)
        page.get_by_label("The same again").fill(PASSWORD)
        page.get_by_role("button", name="Begin").click()
        page.get_by_role("link", name="Signed in as Karl Berg").click()
        page.get_by_role("heading", name="Account").wait_for()
        at.close()
    assert at.errors == []


@pytest.mark.parametrize("theme", ["light", pytest.param("dark", marks=pytest.mark.long)])
@pytest.mark.parametrize("path", ADMIN_PAGES)
def test_a_phone_never_scrolls_sideways(opened: Opened, path: str, theme: str) -> None:
    """With everything unfolded, long addresses and a name of 27 signs."""
    page = opened.page(path, viewport=PHONE, color_scheme=theme)
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert page.locator("html").get_attribute("data-theme") == theme


@pytest.mark.parametrize("path", [*ADMIN_PAGES, "/login"])
def test_every_field_has_a_label_and_a_place_by_keyboard(opened: Opened, path: str) -> None:
    """No field depends on its position to be understood."""
    page = opened.page(path, viewport=DESK)
    page.evaluate("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    unnamed = page.locator("input:not([type=hidden]), select, button").evaluate_all(
        """all => all.filter(one => !(one.labels && one.labels.length)
            && !one.getAttribute('aria-label') && !one.textContent.trim())
            .map(one => one.outerHTML)"""
    )
    assert unnamed == []
    assert page.locator("[tabindex]:not([tabindex='-1']):not([tabindex='0'])").count() == 0


def test_a_token_is_made_and_shown_once(opened: Opened) -> None:
    """Ticked, made, copied; a reload of the account does not show it again."""
    page = opened.page("/account")
    page.get_by_label("What it is for").fill("shift report")
    page.get_by_label("act").check()
    page.get_by_role("button", name="Make the token").click()
    assert page.get_by_label("Token", exact=True).input_value().startswith("stw_")
    page.goto(opened.base + "/account")
    assert page.locator("td", has_text="stw_").count() == 1
    assert page.get_by_label("Token", exact=True).count() == 0


@pytest.mark.long
def test_an_admin_disables_somebody(opened: Opened, peopled: Site) -> None:
    """Unfolded, clicked, said; the card tells it."""
    page = opened.page("/users")
    card = page.locator(".card", has_text=NAMES[UserRole.VIEWER])
    card.locator("summary").click()
    card.get_by_role("button", name="Disable").click()
    page.get_by_text("The user is disabled").wait_for()
    assert "disabled" in page.locator(".card", has_text=NAMES[UserRole.VIEWER]).inner_text()
    assert peopled.store.accounts.find(NAMES[UserRole.VIEWER]).disabled == NOW
