"""Reading the TOML text itself: the file, its encoding, its grammar."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from stemwatch.service.plantfile.lines import TomlLines
from stemwatch.service.plantfile.problem import PlantFileError, Problem

_AT_LINE = re.compile(r"\s*\(at line (\d+), column (\d+)\)")
_AT_END = re.compile(r"\s*\(at end of document\)")


def read_toml(file: Path) -> tuple[dict[str, Any], TomlLines]:
    """The tables of ``file`` and the line of each key. Raises ``PlantFileError`` when there is no
    such file, when it is not UTF-8 and when it is not TOML."""
    text = _text(file)
    try:
        return tomllib.loads(text), TomlLines(text)
    except tomllib.TOMLDecodeError as error:
        raise _not_toml(file, text, str(error)) from None
    except RecursionError:
        raise _error(file, None, "brackets inside brackets without end", "plain tables") from None


def _text(file: Path) -> str:
    try:
        raw = file.read_bytes()
    except FileNotFoundError:
        raise _error(file, None, f"no such file in {file.parent}", "a plant file") from None
    except OSError as error:
        found = f"a file that cannot be read ({error.strerror})"
        raise _error(file, None, found, "a plant file") from None
    try:
        # Windows editors begin UTF-8 with a byte order mark and end lines with two characters.
        return raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        found = f"the byte 0x{raw[error.start]:02x}, which is not UTF-8"
        raise _error(file, line, found, "the file saved as UTF-8") from None


def _not_toml(file: Path, text: str, message: str) -> PlantFileError:
    line = text.count("\n") + 1
    if at := _AT_LINE.search(message):
        line = int(at[1])
    found = _AT_LINE.sub("", _AT_END.sub(" at the end of the file", message))
    return _error(file, line, f"text that is not TOML ({found})", _advice(text, line, message))


def _advice(text: str, line: int, message: str) -> str:
    shown = text.split("\n")[line - 1]
    if "\\" in shown and ("Unescaped" in message or "Hex value" in message):
        return "Windows paths in single quotes ('C:\\exports\\*.csv') or with forward slashes"
    if "Cannot overwrite" in message or "Cannot declare" in message:
        return 'each key and each table once; lists of tables have double brackets: "[[valves]]"'
    if "Invalid value" in message:
        return 'a text in quotation marks, a number with a decimal point, true or false, "[list]"'
    return 'TOML: one key = value on a line, texts in "quotation marks"'


def _error(file: Path, line: int | None, found: str, expected: str) -> PlantFileError:
    problem = Problem(file=file.name, line=line, key="file", found=found, expected=expected)
    return PlantFileError([problem])
