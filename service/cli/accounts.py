"""``stemwatch accounts``: users of the pages, managed on the machine that the service runs on.

No password is set here: people choose their own with one-time links.
"""

from __future__ import annotations

import getpass
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli.store_options import PlantOfStore, StoreUrl, named_store

if TYPE_CHECKING:
    from stemwatch.service.store.accounts.records import OneTimeLinkKind, User, UserRole
    from stemwatch.service.store.store import Store

accounts_app = typer.Typer(
    name="accounts", no_args_is_help=True, help="Users of the pages, and one-time links for them."
)
Name = Annotated[str, typer.Argument(help="The user's name.")]
RoleWord = Annotated[str, typer.Option(help="viewer, engineer or admin.")]
PAGES = "http://127.0.0.1:8300/"
Address = Annotated[
    str,
    typer.Option(
        help="Where the pages are, for the link; by default the address that the plant file "
        f"gives under \\[service], else {PAGES}.",
        show_default=False,
    ),
]


@accounts_app.command("list")
def list_users(plant: PlantOfStore = None, db: StoreUrl = "") -> None:
    """List the users with their roles."""
    from stemwatch.service.cli import views

    with _store(plant, db) as store:
        users = store.accounts.all()
    for user in users:
        seen = "not signed in with a password yet"  # a one-time link also lets in
        if user.last_login:
            seen = f"last signed in {user.last_login:%Y-%m-%d %H:%M} UTC"
        state = ", disabled" if user.disabled else ""
        line = f"{user.name}: {user.role}{state}, {seen}"
        views.out.print(views.escape(line), highlight=False, soft_wrap=True)
    if not users:
        views.out.print("Nobody can sign in yet.", highlight=False)
        views.say_next("`stemwatch accounts first-link` makes the link for the first admin.")
    else:
        views.say_next("`stemwatch accounts add` makes the link for one more.")


@accounts_app.command("first-link")
def first_link(plant: PlantOfStore = None, db: StoreUrl = "", address: Address = "") -> None:
    """Print a new one-time link for the first admin; an earlier one becomes invalid."""
    from stemwatch.service.access import links

    with _store(plant, db) as store:
        link = links.first_link(store, _pages(plant, address))
        if link is None:
            raise typer.BadParameter(
                "somebody can sign in already; 'accounts add --role admin' makes a link for one "
                "more admin, 'accounts reset NAME' one for a new password"
            )
        _note(store, "manage users", "link for the first admin")
    _show(link)


@accounts_app.command("add")
def add(
    note: Annotated[str, typer.Argument(help="For whom the link is.")] = "",
    role: RoleWord = "viewer",
    plant: PlantOfStore = None,
    db: StoreUrl = "",
    address: Address = "",
) -> None:
    """Print a one-time link at which a new user chooses name and password."""
    from stemwatch.service.store.accounts.records import OneTimeLinkKind

    with _store(plant, db) as store:
        link = _link(store, _pages(plant, address), OneTimeLinkKind.INVITATION, _role(role), note)
        _note(store, "manage users", f"invite {note}; role {role}")
    _show(link)


@accounts_app.command("reset")
def reset(name: Name, plant: PlantOfStore = None, db: StoreUrl = "", address: Address = "") -> None:
    """Print a one-time link at which a user chooses a new password."""
    from stemwatch.service.store.accounts.records import OneTimeLinkKind

    with _store(plant, db) as store:
        user = _user(store, name)
        if user.disabled is not None:
            raise typer.BadParameter(f"{user.name} is disabled; enable the user first")
        link = _link(
            store, _pages(plant, address), OneTimeLinkKind.PASSWORD, user.role, user.name, user.id
        )
        _note(store, "manage users", f"link for a new password; {user.name}")
    _show(link)


@accounts_app.command("set-role")
def set_role(
    name: Name,
    role: Annotated[str, typer.Argument(help="viewer, engineer or admin.")],
    plant: PlantOfStore = None,
    db: StoreUrl = "",
) -> None:
    """Change a user's role, with immediate effect."""
    with _store(plant, db) as store:
        user = _user(store, name)
        store.accounts.set_role(user.id, _role(role))
        _note(store, "manage users", f"{user.name}; role {role}; before {user.role}")
    _say_done(f"{user.name} is {role} now.")


@accounts_app.command("disable")
def disable(name: Name, plant: PlantOfStore = None, db: StoreUrl = "") -> None:
    """Disable a user: sessions end, links are withdrawn, tokens are invalid until enabled again."""
    with _store(plant, db) as store:
        user = _user(store, name)
        store.accounts.disable(user.id, datetime.now(UTC))
        _note(store, "manage users", f"{user.name}; disable")
    _say_done(f"{user.name} cannot sign in any more.")


@accounts_app.command("enable")
def enable(name: Name, plant: PlantOfStore = None, db: StoreUrl = "") -> None:
    """Allow a disabled user to sign in again."""
    with _store(plant, db) as store:
        user = _user(store, name)
        store.accounts.enable(user.id)
        _note(store, "manage users", f"{user.name}; enable")
    _say_done(f"{user.name} can sign in again.")


@contextmanager
def _store(plant: Path | None, db: str) -> Iterator[Store]:
    from stemwatch.service.store.store import open_existing_store

    address, _ = named_store(None if db else plant, db)
    with open_existing_store(address) as store:
        yield store


def _pages(plant: Path | None, address: str) -> str:
    """Where people reach the pages: as the command says, else as the plant file does. A link to
    this machine opens nothing on the computer of whoever gets it."""
    from stemwatch.service.config import load_plant

    if address or plant is None:
        return address or PAGES
    return load_plant(plant).service.address or PAGES


def _user(store: Store, name: str) -> User:
    from stemwatch.connectors.connector import nearest_names

    user = store.accounts.find(name)
    if user is None:
        names = [known.name for known in store.accounts.all()]
        raise typer.BadParameter(
            f"there is no user {name!r}; nearest: {nearest_names(name, names) or 'none'}",
            param_hint="NAME",
        )
    return user


def _role(word: str) -> UserRole:
    from stemwatch.service.store.accounts.records import UserRole

    if word not in list(UserRole):
        raise typer.BadParameter(f"{', '.join(UserRole)} is expected, received {word!r}")
    return UserRole(word)


def _link(
    store: Store,
    address: str,
    kind: OneTimeLinkKind,
    role: UserRole,
    note: str,
    user: int | None = None,
) -> str:
    from stemwatch.service.access.links import address_of, make_link

    now = datetime.now(UTC)
    secret, _ = make_link(store, kind, role, made_by="command line", now=now, user=user, note=note)
    return address_of(secret, address)


def _show(link: str) -> None:
    from stemwatch.service.cli import views

    views.out.print(views.escape(link), highlight=False, soft_wrap=True)
    views.say_next("give it only to the person it is for: it works once.")


def _say_done(text: str) -> None:
    from stemwatch.service.cli import views

    views.say(text)
    views.say_next("`stemwatch accounts list` shows all users.")


def _note(store: Store, action: str, subject: str) -> None:
    """Add an entry to the audit log in the name of the machine's user."""
    from stemwatch.service.store.accounts.records import AuditEntry

    try:
        user = getpass.getuser()
    except (KeyError, OSError):  # a container may have no name for its user
        user = "somebody on this machine"
    now = datetime.now(UTC)
    store.audit.add(
        AuditEntry(at=now, who=user, how="command line", address="", action=action, about=subject)
    )
