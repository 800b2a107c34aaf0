"""The table of rights, and the audit log, which cannot be changed."""

from __future__ import annotations

import ast
import inspect
from dataclasses import replace
from datetime import timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stemwatch.service.access.permissions import PERMISSIONS, CurrentUser, Operation, scopes_of
from stemwatch.service.store.accounts import audit
from stemwatch.service.store.accounts.audit import AuditFilter, AuditLog
from stemwatch.service.store.accounts.records import AuditEntry, AuditOutcome, Scope, UserRole
from stemwatch.service.store.store import Store
from tests.service.access.conftest import NOW

ROLES = st.sampled_from(UserRole)
OPERATIONS = st.sampled_from(Operation)
MAY = {
    UserRole.VIEWER: {Operation.READ, Operation.METRICS, Operation.OWN, Operation.LOG_OUT},
    UserRole.ENGINEER: {
        *(Operation.ALERT, Operation.NOTE, Operation.MAINTENANCE, Operation.BASELINE),
        *(Operation.RUN, Operation.CANCEL, Operation.FEEDBACK),
    },
    UserRole.ADMIN: {
        *(Operation.SETTINGS, Operation.USERS, Operation.TOKENS, Operation.AUDIT),
        Operation.UNDECLARED,
    },
}


def test_every_operation_has_its_right() -> None:
    """The table equals the documented one."""
    assert set(PERMISSIONS) == set(Operation)
    for role, operations in MAY.items():
        assert {item for item in Operation if PERMISSIONS[item].least is role} == operations
    assert [item for item in Operation if PERMISSIONS[item].least is None] == [Operation.OPEN]


@given(ROLES, ROLES, OPERATIONS)
def test_a_higher_role_may_all_that_a_lower_may(
    item: UserRole, other: UserRole, what: Operation
) -> None:
    """Signed in by a password."""
    lower, higher = sorted((item, other), key=lambda role: role.rank)
    if CurrentUser(name="", role=lower, signed_in_by="").may(what):
        assert CurrentUser(name="", role=higher, signed_in_by="").may(what)


@given(ROLES, st.frozensets(st.sampled_from(Scope)), OPERATIONS)
def test_a_token_may_nothing_that_its_user_may_not(
    role: UserRole, scopes: frozenset[Scope], what: Operation
) -> None:
    """Whatever its scopes; and without a scope nothing but what is open to all."""
    token = CurrentUser(name="", role=role, signed_in_by="", scopes=scopes)
    if token.may(what):
        assert CurrentUser(name="", role=role, signed_in_by="").may(what)
        assert scopes or what is Operation.OPEN


@pytest.mark.parametrize("role", UserRole)
def test_the_scopes_of_a_role_are_those_it_can_use(role: UserRole) -> None:
    """As many as its rank says."""
    assert len(scopes_of(role)) == role.rank + 1


@pytest.mark.parametrize(
    ("text", "signed"),
    [("", "Ann"), ("Ann", "Ann"), (" K.  Berg ", "K. Berg (through Ann)"), (" ", "Ann")],
)
def test_what_is_signed_always_names_who_is_signed_in(text: str, signed: str) -> None:
    """For whomever a program says that it acts."""
    assert (
        CurrentUser(name="Ann", role=UserRole.ENGINEER, signed_in_by="").signature(text) == signed
    )


def test_the_audit_log_is_added_to_and_read_and_nothing_else() -> None:
    """Its class has no other method, and its module neither updates nor deletes."""
    public = {name for name in vars(AuditLog) if not name.startswith("_")}
    assert public == {"add", "read", "actions"}
    names = {
        node.id if isinstance(node, ast.Name) else node.attr
        for node in ast.walk(ast.parse(inspect.getsource(audit)))
        if isinstance(node, ast.Name | ast.Attribute)
    }
    assert names & {"update", "delete", "upsert", "merge"} == set()


def entry(number: int, **changes: str) -> AuditEntry:
    """An entry, a minute after the one before."""
    fields = {"who": "Ann", "how": "session", "address": "192.0.2.7", "action": "add a note"}
    return AuditEntry(at=NOW + timedelta(minutes=number), **{**fields, **changes})


def test_the_log_is_read_by_who_what_when_and_outcome(store: Store) -> None:
    """The newest first, page by page without a gap when something is added meanwhile."""
    for number in range(10):
        store.audit.add(entry(number, who="Bob" if number % 2 else "Ann"))
    store.audit.add(AuditEntry(**{**vars(entry(10)), "outcome": AuditOutcome.REFUSED}))
    assert len(store.audit.read(AuditFilter(who="Bob"))) == 5
    assert len(store.audit.read(AuditFilter(outcome=AuditOutcome.REFUSED))) == 1
    assert store.audit.read(AuditFilter(action="sign in")) == []
    start, stop = NOW + timedelta(minutes=3), NOW + timedelta(minutes=6)
    assert [item.at.minute for item in store.audit.read(AuditFilter(start=start, stop=stop))] == [
        5,
        4,
        3,
    ]
    first = store.audit.read(AuditFilter(limit=4))
    store.audit.add(entry(11))
    second = store.audit.read(AuditFilter(limit=4, before=first[-1].id))
    assert [item.at.minute for item in first + second] == [10, 9, 8, 7, 6, 5, 4, 3]
    assert store.audit.actions() == ["add a note"]


def test_what_somebody_sends_cannot_fill_the_log(store: Store) -> None:
    """Long fields are cut."""
    for how, longest in (("", audit.LONGEST), ("session", audit.LONGEST_SIGNED_IN)):
        store.audit.add(replace(entry(0, about="x" * 20_000), how=how))
        about = store.audit.read(AuditFilter())[0].about
        assert len(about) == longest
        assert about.endswith("x … (cut)")
