"""What the API gives of who may do what."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, Field

from stemwatch.service.store.accounts.records import Outcome, Role, Scope


class MeAnswer(BaseModel):
    """Who asks, as the service sees it."""

    name: str
    role: Role
    how: str = Field(description="session, or the name of the token")
    scopes: list[Scope] | None = Field(description="of a token; null for a session")
    may: list[str] = Field(description="the operations that are allowed")


class AuditLine(BaseModel):
    """One entry of the audit log."""

    id: int
    at: datetime
    who: str = Field(description="empty where nobody was signed in")
    how: str
    address: str
    action: str
    about: str
    outcome: Outcome
    detail: str
