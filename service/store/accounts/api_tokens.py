"""``ApiTokens``: tokens with which programs use the API in the name of a user."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime

from sqlalchemy import Select, select, update

from stemwatch.service.store.accounts.records import ApiToken, Scope
from stemwatch.service.store.accounts.tables import TokenRow, UserRow
from stemwatch.service.store.accounts.users import user_of
from stemwatch.service.store.database.transactions import Transactions
from stemwatch.service.store.storable import from_row


class ApiTokens:
    """API tokens; only their digests are stored. Methods raise ``StoreError``."""

    def __init__(self, transactions: Transactions) -> None:
        self._transactions = transactions

    def add(
        self,
        digest: str,
        user: int,
        name: str,
        scopes: Sequence[Scope],
        *,
        begins: str,
        now: datetime,
        expires: datetime | None,
    ) -> int:
        """Store a new token of ``user`` and return its number."""
        with self._transactions.writing("adding a token") as session:
            row = TokenRow(
                user_id=user,
                name=name,
                digest=digest,
                begins=begins,
                scopes=[scope.value for scope in scopes],
                created=now,
                expires=expires,
                last_used=None,
                revoked=None,
            )
            session.add(row)
            session.flush()
            return row.id

    def find(self, digest: str) -> ApiToken | None:
        """The token with this digest, also where it is no longer valid."""
        with self._transactions.reading() as session:
            row = session.execute(_with_user().where(TokenRow.digest == digest)).one_or_none()
            return None if row is None else _token_of(*row)

    def get(self, token: int) -> ApiToken | None:
        """The token with this number."""
        with self._transactions.reading() as session:
            row = session.execute(_with_user().where(TokenRow.id == token)).one_or_none()
            return None if row is None else _token_of(*row)

    def all(self, user: int | None = None) -> list[ApiToken]:
        """Every token, or those of one user, the newest first."""
        statement = _with_user().order_by(TokenRow.id.desc())
        if user is not None:
            statement = statement.where(TokenRow.user_id == user)
        with self._transactions.reading() as session:
            return [_token_of(*row) for row in session.execute(statement)]

    def note_use(self, token: int, now: datetime) -> None:
        """Record when a token was last used."""
        with self._transactions.writing("noting a token's use") as session:
            session.execute(update(TokenRow).where(TokenRow.id == token).values(last_used=now))

    def revoke(self, token: int, now: datetime) -> None:
        """Make this token invalid from ``now`` on."""
        with self._transactions.writing("revoking a token") as session:
            session.execute(
                update(TokenRow)
                .where(TokenRow.id == token, TokenRow.revoked.is_(None))
                .values(revoked=now)
            )


def _with_user() -> Select[TokenRow, UserRow]:
    return select(TokenRow, UserRow).join(UserRow, UserRow.id == TokenRow.user_id)


def _token_of(row: TokenRow, user: UserRow) -> ApiToken:
    return from_row(
        ApiToken, row, user=user_of(user), scopes=tuple(Scope(scope) for scope in row.scopes)
    )
