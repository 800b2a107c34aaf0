"""Bytes to lines of text: compression, encoding, line ends, repaired degree signs."""

from __future__ import annotations

import hashlib
import io
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from stemwatch.connectors.connector import UnreadableSource
from stemwatch.connectors.historian.reading_notes import ReadingNotes

MAX_TEXT_BYTES = 4 * 1024**3
# Exports of measurements compress by a factor of 5 to 50. A file that unpacks to more than this
# factor, beyond a small size, is no export, or one made to exhaust the memory.
MAX_EXPANSION = 200
EXPANSION_ALLOWED_BYTES = 256 * 1024**2
# Stands in a cell where bytes were lost; the same character as for undecodable bytes.
LOST = "\ufffd"
_CHUNK = 1 << 16
GZIP = b"\x1f\x8b"
_BOMS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
_FOREIGN = (
    (b"PK\x03\x04", "is a zip archive or an Excel workbook; save the sheet as CSV"),
    (b"\xd0\xcf\x11\xe0", "is an old Excel workbook; save the sheet as CSV"),
    (b"%PDF", "is a PDF document; export the data as CSV"),
    (
        b"PAR1",
        'is a Parquet file, which is read through a plant file: kind = "parquet" of a source '
        "(docs/archives.md)",
    ),
)
_HIGH_RUN = re.compile(rb"[\x80-\xff]+")
_CONTROL = bytes(set(range(32)) - {9, 10, 12, 13, 26})
# A sign outside ASCII that was read as cp1252 and saved again as UTF-8: "Â°C" for "°C".
_TWICE_ENCODED = re.compile("Â([°²³µ%·±])")


@dataclass(frozen=True, kw_only=True)
class Document:
    """One file as text. ``lines[i]`` is line ``i + 1``, without its end."""

    path: Path
    lines: list[str]
    encoding: str
    digest: str
    ends_whole: bool  # the last line ends with a line end, so that it cannot have been cut

    @property
    def name(self) -> str:
        return str(self.path)


def open_document(path: Path, encoding: str | None, notes: ReadingNotes) -> Document:
    """The file at ``path`` as lines. Raises ``UnreadableSource`` where it is not text."""
    return read_document(_read(path), path, encoding, notes)


def read_document(raw: bytes, path: Path, encoding: str | None, notes: ReadingNotes) -> Document:
    """The bytes of a file as lines.

    Order: gzip by its magic bytes, byte order mark, the caller's encoding, NULs of UTF-16, strict
    UTF-8, GB18030 where the bytes fit it, cp1252.
    """
    digest = hashlib.sha256(raw).hexdigest()
    data = _inflate(raw, path, notes)
    refuse_foreign(data, path)
    chosen = encoding or _detect(data)
    text = _clean(_decode(data, chosen, path, notes), notes)
    if not text.strip():
        raise UnreadableSource(f"{path}: the file is empty; expected a header and rows of data")
    lines = text.split("\n")
    ends_whole = lines[-1] == ""
    return Document(
        path=path,
        lines=lines[:-1] if ends_whole else lines,
        encoding=chosen,
        digest=digest,
        ends_whole=ends_whole,
    )


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise UnreadableSource(
            f"{path}: cannot be opened ({error.strerror or error}); check path and permissions"
        ) from error


def _inflate(raw: bytes, path: Path, notes: ReadingNotes) -> bytes:
    """The unpacked gzip members; of a damaged archive as much as can be recovered."""
    if not raw.startswith(GZIP):
        return raw
    return b"".join(unpacked(io.BytesIO(raw), len(raw), path, notes))


def unpacked(file: BinaryIO, size: int, path: Path, notes: ReadingNotes) -> Iterator[bytes]:
    """The text of every gzip member of ``file``, of ``size`` bytes, in small pieces; of a damaged
    archive as much as can be recovered.

    Raises ``UnreadableSource`` where there is none, or more than an export can unpack to.
    """
    size_so_far = 0
    try:
        for piece in _members(file):
            size_so_far += len(piece)
            _refuse_expansion(size_so_far, size, path)
            yield piece
    except zlib.error as error:
        if not size_so_far:
            raise UnreadableSource(
                f"{path}: the gzip archive is damaged ({error}); copy it again from its source"
            ) from error
        notes.problem(f"the gzip archive is damaged ({error}); only its readable start was used")
    notes.decide("The file is compressed with gzip.")


def _members(file: BinaryIO) -> Iterator[bytes]:
    unpacker = zlib.decompressobj(wbits=31)
    data = file.read(_CHUNK)
    while data:
        yield unpacker.decompress(data)  # at most 64 MiB: gzip packs 1,032 times
        data = unpacker.unused_data if unpacker.eof else b""
        if len(data) < len(GZIP):
            data += file.read(_CHUNK)
        if unpacker.eof:
            if not data.startswith(GZIP):
                return
            unpacker = zlib.decompressobj(wbits=31)
    raise zlib.error("it ends early")


def _refuse_expansion(unpacked: int, size: int, path: Path) -> None:
    if unpacked > max(EXPANSION_ALLOWED_BYTES, MAX_EXPANSION * size):
        raise UnreadableSource(
            f"{path}: unpacks to more than {MAX_EXPANSION} times its size: {unpacked >> 20} MB "
            f"from {size >> 10} kB; expected an export, whose measurements pack 5 to 50 times. "
            "If it is one, unpack it and split it"
        )
    if unpacked > MAX_TEXT_BYTES:
        raise UnreadableSource(
            f"{path}: unpacks to more than {MAX_TEXT_BYTES >> 30} GiB; split the export"
        )


def refuse_foreign(data: bytes, path: Path) -> None:
    """Raise ``UnreadableSource`` for archives and documents, known by their first bytes."""
    for magic, description in _FOREIGN:
        if data.startswith(magic):
            raise UnreadableSource(f"{path}: {description}.")


def _detect(data: bytes) -> str:
    encoding = marked_encoding(data)
    if encoding is not None:
        return encoding
    try:
        data.decode("utf-8")
        return "utf-8"
    except UnicodeDecodeError as error:
        # A file cut inside its last character is still UTF-8.
        if error.start >= len(data) - 3 and error.reason == "unexpected end of data":
            return "utf-8"
    return "gb18030" if in_byte_pairs(data) and _decodes(data, "gb18030") else "cp1252"


def marked_encoding(head: bytes) -> str | None:
    """The encoding that a byte order mark or the NULs of UTF-16 in the first bytes tell."""
    for mark, name in _BOMS:
        if head.startswith(mark):
            return name
    head = head[:4096]
    low, high = head[::2].count(0), head[1::2].count(0)
    # A block of NULs that a power cut left has them on both sides of each pair.
    if low + high > 0.3 * len(head) and len(head) > 3 and min(low, high) < 0.2 * max(low, high):
        return "utf-16-le" if high > low else "utf-16-be"
    return None


def in_byte_pairs(head: bytes) -> bool:
    """Whether the first MiB has runs of byte pairs, as Chinese writes them; western text has single
    high bytes among ASCII."""
    runs = _HIGH_RUN.findall(head[: 1 << 20])
    paired = sum(len(run) % 2 == 0 and _decodes(run, "gb2312") for run in runs)
    return bool(runs) and paired >= 0.8 * len(runs)


def _decodes(data: bytes, encoding: str) -> bool:
    try:
        data.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def _decode(data: bytes, encoding: str, path: Path, notes: ReadingNotes) -> str:
    try:
        text = data.decode(encoding)
    except (UnicodeDecodeError, UnicodeError, LookupError) as error:
        text = _decode_damaged(data, encoding, error, notes)
    controls = text[:65536].encode("utf-8", "replace").translate(None, _CONTROL)
    lost = len(text[:65536].encode("utf-8", "replace")) - len(controls) - text[:65536].count("\0")
    if lost > 0.02 * max(1, len(text[:65536])):
        raise UnreadableSource(
            f"{path}: is not text ({lost} control characters in its first part); expected a CSV "
            "or text export"
        )
    notes.decide(f"The text is {encoding}.")
    return text


def _decode_damaged(data: bytes, encoding: str, error: Exception, notes: ReadingNotes) -> str:
    # Latin-1 maps every byte, so a damaged byte stays visible in its cell and affects no other
    # cell.
    fallback = "latin-1" if encoding in ("cp1252",) else encoding
    text = data.decode(fallback, errors="strict" if fallback == "latin-1" else "replace")
    notes.problem(f"some bytes are not {encoding} ({error}); their cells are unreadable")
    return text


def _clean(text: str, notes: ReadingNotes) -> str:
    text = text.removeprefix("\ufeff").replace("\r\n", "\n").replace("\r", "\n").rstrip("\x1a")
    if "\0" in text:
        text = mark_lost(text, 1, notes)
    text, repaired = once_encoded(text)
    say_repaired(repaired, notes)
    return text


def once_encoded(text: str) -> tuple[str, int]:
    """``text`` with signs such as 'Â°' as they were meant, and how many there were."""
    return _TWICE_ENCODED.subn(r"\1", text) if "Â" in text else (text, 0)


def say_repaired(signs: int, notes: ReadingNotes) -> None:
    """The sentence about signs that were encoded twice."""
    if signs:
        notes.decide(f"{signs} signs written as in 'Â°' were read as '°' (encoded twice).")


def mark_lost(text: str, first: int, notes: ReadingNotes) -> str:
    """Mark NULs, which stand where bytes were lost: the rest of such a cell is not a number.

    ``first`` is the number of the first line of ``text``.
    """
    lines = text.split("\n")
    for i, line in enumerate(lines):
        if "\0" not in line:
            continue
        only = not line.strip("\0 \t")
        description = "only lost bytes" if only else "a cell that lost bytes; it is unreadable"
        notes.problem(f"line {first + i}: {description} ({line.count(chr(0))} NUL characters)")
        lines[i] = "" if only else line.replace("\0", LOST)
    return "\n".join(lines)
