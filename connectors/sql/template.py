"""Query templates: one statement that only reads, with named parameters that are bound."""

from __future__ import annotations

import re
from typing import NamedTuple

PARAMETERS = ("tag", "start", "end")
_QUOTED = re.compile(r"'(?:[^']|'')*'|\"(?:[^\"]|\"\")*\"|`[^`]*`|\[[^\]\n]*\]")
_COMMENT = re.compile(r"--[^\n]*|/\*.*?\*/", re.S)
_DOLLAR = re.compile(r"\$(\w*)\$")
_PARAMETER = re.compile(r"(?<![:\w\\]):([A-Za-z_]\w*)(?!:)")
# Words that change data, its structure, the session or files, in any engine that SQLAlchemy knows.
_WRITING = frozenset(
    ("insert", "update", "delete", "merge", "upsert", "drop", "alter", "create", "truncate",
     "grant", "revoke", "call", "exec", "execute", "into", "copy", "vacuum", "attach", "detach",
     "pragma", "lock", "reindex", "analyze", "do", "load", "import", "export", "rename", "begin",
     "commit", "rollback", "savepoint", "declare", "kill", "shutdown", "nextval", "setval")
)  # fmt: skip


class Fault(NamedTuple):
    """What is wrong with a template, as an error says it."""

    found: str
    expected: str


def fault_of(text: str, *, with_tag: bool = True) -> Fault | None:
    """Why ``text`` cannot be used as a template, or ``None``.

    It must be one SELECT, which may begin with WITH, without any word that writes; ``with_tag``:
    it must have the parameters ``:tag``, ``:start`` and ``:end``, else none at all. This is the
    first of three guards: the transaction is read only where the engine can, and is never
    committed.
    """
    wanted = "one statement that begins with SELECT or WITH and only reads"
    if _DOLLAR.search(_QUOTED.sub(" ", text)):
        return Fault("a dollar-quoted text", "texts between single quotes")
    bare = _bare(text)
    if ";" in bare:
        return Fault("several statements", wanted)
    words = re.findall(r"[a-z_]\w*", bare.lower())
    if not words or words[0] not in ("select", "with"):
        return Fault(
            f"a statement that begins with {repr(words[0]) if words else 'nothing'}", wanted
        )
    writing = [word for word in words if word in _WRITING]
    if writing:
        hint = "; put a column of that name in double quotes"
        return Fault(f"the word {writing[0]!r}", wanted + hint)
    if re.search(r"\bfor\s+(?:no\s+key\s+)?(?:update|share|key)", bare, re.I):
        return Fault("a lock (FOR UPDATE)", wanted)
    named = set(_PARAMETER.findall(bare))
    needed = set(PARAMETERS) if with_tag else set()
    if named != needed:
        shown = ", ".join(f":{name}" for name in sorted(named)) or "none"
        expected = ", ".join(f":{name}" for name in PARAMETERS) if with_tag else "none"
        return Fault(f"the parameters {shown}", f"the parameters {expected}, not in quotes")
    return None


def _bare(text: str) -> str:
    """The statement without quoted texts, comments and the semicolon at its end."""
    return _COMMENT.sub(" ", _QUOTED.sub(" '' ", text)).strip().rstrip(";").strip()
