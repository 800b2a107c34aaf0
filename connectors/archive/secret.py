"""``Secret``: a password or an address with one, shown nowhere and read where it is used."""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from pathlib import Path

from stemwatch.connectors.connector import ConnectorError

_USER_PASSWORD = re.compile(r"(?P<before>://[^:@/?\s]*:)\S*(?=@)")


@dataclass(frozen=True, kw_only=True)
class Secret:
    """Text that is given, or that an environment variable or a file holds where it is used.

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
            if self.variable not in os.environ:
                raise ConnectorError(
                    f"the environment variable {self.variable} is not set; the plant file says "
                    "that it holds a secret. Set it for every process that reads this source"
                )
            return os.environ[self.variable]
        if self.file:
            try:
                return Path(self.file).read_text("utf-8").strip()
            except (OSError, UnicodeDecodeError) as error:
                raise ConnectorError(
                    f"{self.file}: the secret cannot be read ({type(error).__name__}); expected a "
                    "text file that this account may read"
                ) from None
        return self.text

    def __str__(self) -> str:
        return self.variable or self.file or ("***" if self.text else "")


def without_password(text: str) -> str:
    """``text`` with the password of every URL in it replaced by ``***``."""
    return _USER_PASSWORD.sub(r"\g<before>***", text)
