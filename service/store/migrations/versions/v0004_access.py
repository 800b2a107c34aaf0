"""Users, one-time links, sessions, tokens, throttling and the audit log."""

from __future__ import annotations

from typing import Any

import sqlalchemy as sa
from alembic import op

from stemwatch.service.store.database.columns import CleanJson, CleanText, UtcDateTime

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    _users()
    _links()
    _sessions()
    _tokens()
    _attempts()
    _audit()


def downgrade() -> None:
    for table in ("audit", "login_attempts", "api_tokens", "web_sessions", "access_links", "users"):
        op.drop_table(table)


def _text(name: str) -> sa.Column[Any]:
    return sa.Column(name, CleanText(), nullable=False)


def _whole(name: str) -> sa.Column[Any]:
    return sa.Column(name, sa.Integer(), nullable=False)


def _time(name: str) -> sa.Column[Any]:
    return sa.Column(name, UtcDateTime(), nullable=False)


def _time_or_null(name: str) -> sa.Column[Any]:
    return sa.Column(name, UtcDateTime(), nullable=True)


def _of_user(table: str) -> sa.ForeignKeyConstraint:
    name = f"fk_{table}_user_id_users"
    return sa.ForeignKeyConstraint(["user_id"], ["users.id"], name=name, ondelete="CASCADE")


def _users() -> None:
    op.create_table(
        "users",
        _whole("id"),
        *(_text(name) for name in ("name", "name_key", "role", "password")),
        _time("created"),
        _text("created_by"),
        _time("password_changed"),
        _time_or_null("last_login"),
        _time_or_null("disabled"),
        sa.PrimaryKeyConstraint("id", name="pk_users"),
    )
    op.create_index("uq_users_name_key", "users", ["name_key"], unique=True)


def _links() -> None:
    op.create_table(
        "access_links",
        _whole("id"),
        *(_text(name) for name in ("digest", "kind", "role")),
        sa.Column("user_id", sa.Integer(), nullable=True),
        _text("note"),
        _time("created"),
        _text("created_by"),
        _time("expires"),
        _time_or_null("used"),
        _time_or_null("revoked"),
        _of_user("access_links"),
        sa.PrimaryKeyConstraint("id", name="pk_access_links"),
    )
    op.create_index("uq_access_links_digest", "access_links", ["digest"], unique=True)


def _sessions() -> None:
    op.create_table(
        "web_sessions",
        _text("digest"),
        _whole("user_id"),
        *(_time(name) for name in ("created", "seen", "expires")),
        *(_text(name) for name in ("address", "agent")),
        _of_user("web_sessions"),
        sa.PrimaryKeyConstraint("digest", name="pk_web_sessions"),
    )
    op.create_index("ix_web_sessions_user_id", "web_sessions", ["user_id"])


def _tokens() -> None:
    op.create_table(
        "api_tokens",
        _whole("id"),
        _whole("user_id"),
        *(_text(name) for name in ("name", "digest", "begins")),
        sa.Column("scopes", CleanJson(), nullable=False),
        _time("created"),
        *(_time_or_null(name) for name in ("expires", "last_used", "revoked")),
        _of_user("api_tokens"),
        sa.PrimaryKeyConstraint("id", name="pk_api_tokens"),
    )
    op.create_index("uq_api_tokens_digest", "api_tokens", ["digest"], unique=True)
    op.create_index("ix_api_tokens_user_id", "api_tokens", ["user_id"])


def _attempts() -> None:
    op.create_table(
        "login_attempts",
        _text("key"),
        _whole("count"),
        _time("last"),
        _time("until"),
        sa.PrimaryKeyConstraint("key", name="pk_login_attempts"),
    )


def _audit() -> None:
    op.create_table(
        "audit",
        _whole("id"),
        _time("at"),
        *(_text(name) for name in ("who", "how", "address", "action", "about")),
        *(_text(name) for name in ("outcome", "detail")),
        sa.PrimaryKeyConstraint("id", name="pk_audit"),
    )
    op.create_index("ix_audit_at", "audit", ["at"])
    op.create_index("ix_audit_who_at", "audit", ["who", "at"])
    op.create_index("ix_audit_action_at", "audit", ["action", "at"])
