"""Who may do what: roles, rights, passwords, sessions, tokens, one-time links, throttling."""

from __future__ import annotations
