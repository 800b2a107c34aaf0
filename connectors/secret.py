"""``Secret``: a password or an address with one, shown nowhere and read where it is used.

``masked`` takes passwords out of a text that is to be shown.
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError

MASK = "***"

# Greedy up to the last @: a password may itself hold @ or /, and hiding too much is harmless.
_USER_PASSWORD = re.compile(r"(?P<before>://[^:@/?\s]*:)\S*(?=@)")
_SECRET_IN_QUERY = re.compile(
    r"(?P<before>[?&;](?:[\w-]*(?:password|passwd|passphrase|pwd|secret|token|key))=)[^&;\s]*", re.I
)
# As psql takes an address: host=... password=...
_SECRET_WORD = re.compile(r"(?P<before>(?<!\S)\w*(?:password|passwd)=)(?:'[^']*'|\S*)", re.I)
_SECRET_OPTION = re.compile(r"^(?P<before>-{1,2}[\w-]*(?:password|passwd|secret|token))(?P<eq>=?)")


@dataclass(frozen=True, kw_only=True)
class Secret:
    """A text given directly, or the content of an environment variable or file, read where it is
    used.

    ``repr`` and ``str`` show the name of the variable or file, never the text. Work that goes to
    another machine carries the name: the variable or file must be there.
    """

    text: str = field(default="", repr=False)
    variable: str = ""
    file: str = ""

    def __bool__(self) -> bool:
        return bool(self.text or self.variable or self.file)

    def reveal(self) -> str:
        """The text itself. Raises ``ConnectorError`` where variable or file is not there."""
        if self.variable:
            if not (text := os.environ.get(self.variable)):
                raise ConnectorError(
                    f"the environment variable {self.variable} is not set; the plant file says "
                    "that it holds a secret. Set it for every process that needs it"
                )
            return text
        if self.file:
            try:
                return Path(self.file).read_text("utf-8").strip()
            except (OSError, UnicodeDecodeError) as error:
                raise ConnectorError(
                    f"the secret file {self.file} cannot be read ({type(error).__name__}); "
                    "expected a text file that this account may read"
                ) from None
        return self.text

    def __str__(self) -> str:
        return self.variable or self.file or ("***" if self.text else "")


def masked(text: str) -> str:
    """``text`` with the password of every URL and ``password=...`` in it replaced by ``***``."""
    text = _USER_PASSWORD.sub(rf"\g<before>{MASK}", text)
    text = _SECRET_WORD.sub(rf"\g<before>{MASK}", text)
    return _SECRET_IN_QUERY.sub(rf"\g<before>{MASK}", text)


def masked_command(arguments: Sequence[str]) -> str:
    """A command line as one text, without the passwords of URLs and the values of options such
    as ``--password`` and ``--token``."""
    words: list[str] = []
    hide_next = False
    for word in arguments:
        option = _SECRET_OPTION.match(word)
        if hide_next:
            words.append(MASK)
        elif option and option["eq"]:
            words.append(f"{option['before']}={MASK}")
        else:
            words.append(masked(word))
        hide_next = option is not None and not option["eq"] and not hide_next
    return " ".join(words)
