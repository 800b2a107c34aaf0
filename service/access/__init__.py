"""Roles and rights, passwords, sessions, API tokens, one-time links, throttling of sign-in."""

from __future__ import annotations
