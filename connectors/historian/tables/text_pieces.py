"""The text of a large file in blocks of whole lines: unpacked, decoded and cleaned piece by piece.

Each block is what ``document`` makes of the same lines, as UTF-8. Where a piece alone is not enough
(damaged characters of most encodings, control characters, endless lines), the file is read whole.
"""

from __future__ import annotations

import codecs
import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from stemwatch.connectors.historian.reading_notes import ReadingNotes
from stemwatch.connectors.historian.tables.document import (
    GZIP,
    in_byte_pairs,
    mark_lost,
    marked_encoding,
    once_encoded,
    refuse_foreign,
    say_repaired,
    unpacked,
)

BLOCK = 1024**2  # small enough that the next steps work in the processor's cache
HEAD_LINES, HEAD_BYTES = 1000, 16 * 1024**2
_FEWEST_HEAD_LINES = 50
_SPOTS, _SPOT_BYTES = 200, 1 << 12
_LONGEST_LINE = 64 * 1024**2
_BOM = b"\xef\xbb\xbf"
# Their characters below 128 are those of ASCII, so that a piece without others is text as it is.
_WITH_ASCII = ("cp1250", "cp1251", "cp1252", "iso8859-1", "iso8859-15", "gb18030")


class NotInPieces(Exception):
    """The file may be something else when it is read whole."""


@dataclass(frozen=True)
class TextBlock:
    """Whole lines, each with its end, and what was changed in them."""

    text: bytes
    lines: int
    repaired: int = 0  # signs that were encoded twice
    changed: bool = False  # the text differs from the stored bytes, CR LF aside


@dataclass
class TextPieces:
    """One file as UTF-8 text, as often as it is asked for."""

    path: Path
    encoding: str
    notes: ReadingNotes = field(default_factory=ReadingNotes)
    digest: str = ""
    lines: int = 0
    ends_whole: bool = True
    # From this line on the file's own bytes are the text, byte order mark and CR LF aside; ``None``
    # where they nowhere are.
    as_stored_from: int | None = None
    head: list[str] = field(default_factory=list)
    spots: list[str] = field(default_factory=list)  # lines from everywhere after the head
    damaged: bool = False  # bytes that cp1252 does not know: all is read as latin-1, as ever

    def blocks(self) -> Iterator[TextBlock]:
        """The same lines at every call, whatever is appended to the file meanwhile."""
        lines_read = 0
        for block in self.look(ReadingNotes(), ReadingNotes()):
            left = self.lines - lines_read
            if block.lines > left:
                yield TextBlock(b"".join(block.text.splitlines(keepends=True)[:left]), left)
                return
            lines_read += block.lines
            yield block

    def look(
        self,
        archive: ReadingNotes,
        notes: ReadingNotes,
        see: Callable[[bytes], object] | None = None,
    ) -> Iterator[TextBlock]:
        """All blocks. ``archive`` is told of a damaged archive, ``notes`` of lost bytes; ``see`` is
        given the bytes as they are stored, where they are not packed."""
        line = 1
        for raw in self._whole_lines(self._decoded(_pieces(self.path, archive, see))):
            text, changed, repaired = raw, False, 0
            if b"\r" in raw:
                text = raw.replace(b"\r\n", b"\n")
                changed = b"\r" in text
                text = text.replace(b"\r", b"\n")
            # Searching for two bytes takes longer than everything else here.
            if b"\0" in text or (not text.isascii() and b"\xc3\x82" in text):
                signs = text.decode("utf-8")
                changed = changed or "\0" in signs
                signs, repaired = once_encoded(mark_lost(signs, line, notes))
                text = signs.encode("utf-8")
            block = TextBlock(text, lines_in(text), repaired, changed or repaired > 0)
            yield block
            line += block.lines

    def _whole_lines(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
        """Pieces that end with a line; the last gets an end where it has none."""
        unfinished: list[bytes] = []
        marks = 2 if self.encoding == "utf-8-sig" else 1
        for piece in pieces:
            while marks and piece:
                marks, piece = (
                    (marks - 1 if piece.startswith(_BOM) else 0),
                    piece.removeprefix(_BOM),
                )
            cut = piece.rfind(b"\n") + 1
            if cut:
                yield b"".join((*unfinished, piece[:cut]))
                unfinished = [piece[cut:]]
                continue
            unfinished.append(piece)
            if sum(map(len, unfinished)) > _LONGEST_LINE:
                raise NotInPieces
        last = b"".join(unfinished)
        self.ends_whole = not last
        if last:
            _refuse_half_character(last)
            yield last + b"\n"

    def _decoded(self, pieces: Iterator[bytes]) -> Iterator[bytes]:
        name = "iso8859-1" if self.damaged else codecs.lookup(self.encoding).name
        if name in ("utf-8", "utf-8-sig"):
            yield from pieces
            return
        decoder = codecs.getincrementaldecoder(name)()
        bytes_read = 0
        for piece in pieces:
            if name in _WITH_ASCII and piece.isascii() and not decoder.getstate()[0]:
                yield piece
            else:
                try:
                    yield decoder.decode(piece).encode("utf-8")
                except UnicodeDecodeError as error:
                    error.reason = f"{bytes_read + error.start}"  # counted from the file's start
                    raise
            bytes_read += len(piece)
        yield decoder.decode(b"", final=True).encode("utf-8")


def lines_in(text: bytes) -> int:
    """The line ends of ``text``, several times as quick as ``count``."""
    return int(np.count_nonzero(np.frombuffer(text, dtype=np.uint8) == 10))


def _lines_with_signs(text: bytes) -> int:
    """Lines up to the last one with a character that is not ASCII."""
    signs = np.frombuffer(text, dtype=np.uint8)
    return lines_in(text[: int(np.flatnonzero(signs > 127)[-1])]) + 1


def _has_controls(block: TextBlock) -> bool:
    """Whether there are control characters other than tab and line end."""
    signs = np.frombuffer(block.text, dtype=np.uint8)
    low = int(np.count_nonzero(signs < 32))
    return low > block.lines and low > block.lines + int(np.count_nonzero(signs == 9))


def _refuse_half_character(last: bytes) -> None:
    """Leave a file that ends inside a character to the reader of the whole file."""
    try:
        last.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.reason == "unexpected end of data":
            raise NotInPieces from error
        raise


def is_packed(path: Path) -> bool:
    """Whether the file is a gzip archive. Raises ``OSError``."""
    with path.open("rb") as file:
        return file.read(len(GZIP)) == GZIP


def _pieces(
    path: Path, notes: ReadingNotes, see: Callable[[bytes], object] | None = None
) -> Iterator[bytes]:
    """What the file holds, unpacked, in pieces of about ``BLOCK`` bytes."""
    packed = is_packed(path)
    with path.open("rb") as file:
        if not packed:
            while piece := file.read(BLOCK):
                if see is not None:
                    see(piece)
                yield piece
            return
        buffered: list[bytes] = []
        for piece in unpacked(file, path.stat().st_size, path, notes):
            buffered.append(piece)
            if sum(map(len, buffered)) >= BLOCK:
                yield b"".join(buffered)
                buffered.clear()
        yield b"".join(buffered)


def look_through(path: Path, encoding: str | None) -> TextPieces:
    """One pass over the file: its encoding, digest, number of lines, and lines from everywhere.

    Raises ``NotInPieces`` where it has to be read whole, ``UnreadableSource`` as reading it whole
    does, ``OSError`` where it cannot be opened.
    """
    head = next(_pieces(path, ReadingNotes()), b"")
    refuse_foreign(head, path)
    for name in (encoding,) if encoding else _candidates(head):
        try:
            return _looked_through(TextPieces(path, name))
        except UnicodeDecodeError as error:
            if encoding or marked_encoding(head):
                raise NotInPieces from error
            if name == "cp1252":
                return _damaged(TextPieces(path, name, damaged=True), error)
        except UnicodeError as error:
            raise NotInPieces from error
    raise NotInPieces


def _candidates(head: bytes) -> Iterator[str]:
    encoding = marked_encoding(head)
    if encoding is not None:
        yield encoding
        return
    yield "utf-8"
    if in_byte_pairs(head):
        yield "gb18030"
    yield "cp1252"


def _damaged(text: TextPieces, error: UnicodeDecodeError) -> TextPieces:
    byte = error.object[error.start]
    message = (
        f"'charmap' codec can't decode byte 0x{byte:02x} in position {error.reason}: character "
        "maps to <undefined>"
    )
    text.notes.problem(f"some bytes are not cp1252 ({message}); their cells are unreadable")
    return _looked_through(text)


def _looked_through(text: TextPieces) -> TextPieces:
    """``text`` with what one pass shows."""
    digest = hashlib.sha256()
    archive, notes = ReadingNotes(), ReadingNotes()
    sample = _Sample()
    in_utf8 = text.encoding in ("utf-8", "utf-8-sig")
    repaired, changed, as_stored_from = 0, False, 1
    for block in text.look(archive, notes, digest.update):
        if _has_controls(block):
            raise NotInPieces
        if not block.text.isascii():
            block.text.decode("utf-8")
        changed = changed or block.changed
        if not in_utf8 and not block.text.isascii():
            as_stored_from = sample.lines + _lines_with_signs(block.text) + 1
        repaired += block.repaired
        sample.take(block)
    packed = is_packed(text.path)
    if packed:
        with text.path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256")
    text.digest, text.lines = digest.hexdigest(), sample.lines
    text.head, text.spots = sample.head(), sample.spots()
    if not changed and not packed and (in_utf8 or codecs.lookup(text.encoding).name in _WITH_ASCII):
        text.as_stored_from = as_stored_from
    before = text.notes
    text.notes = archive
    text.notes.take(before)
    text.notes.decide(f"The text is {text.encoding}.")
    text.notes.take(notes)
    say_repaired(repaired, text.notes)
    return text


class _Sample:
    """The first lines, and lines from everywhere: at every so many bytes a few."""

    def __init__(self) -> None:
        self.lines = 0
        self._head: list[bytes] = []
        self._head_bytes = 0
        self._spots: list[bytes] = []
        self._stride, self._there, self._next = 1 << 16, 0, 0

    def take(self, whole_lines: TextBlock) -> None:
        """The next block."""
        block = whole_lines.text
        self.lines += whole_lines.lines
        offset = self._fill_head(block)
        while (begin := max(offset, self._next - self._there)) < len(block):
            if self._whole_head():
                begin = block.find(b"\n", max(0, begin - 1)) + 1
                end = block.find(b"\n", begin + self._spot_bytes()) + 1 or len(block)
                if begin < end:
                    self._spots.append(block[begin:end])
                offset = end
            self._next = self._there + max(offset, begin) + self._stride
            most_spots = min(_SPOTS, HEAD_BYTES // self._spot_bytes()) if self._head else _SPOTS
            if len(self._spots) > 2 * most_spots:
                self._spots = self._spots[::2]
                self._stride *= 2
        self._there += len(block)

    def head(self) -> list[str]:
        """Raises ``NotInPieces`` where lines are so long that few of them were taken."""
        if len(self._head) < min(_FEWEST_HEAD_LINES, self.lines):
            raise NotInPieces
        return [line.decode("utf-8") for line in self._head]

    def spots(self) -> list[str]:
        return b"".join(self._spots).decode("utf-8").split("\n")[:-1]

    def _fill_head(self, block: bytes) -> int:
        offset = 0
        while offset < len(block) and not self._whole_head():
            end = block.find(b"\n", offset)
            self._head.append(block[offset:end])
            self._head_bytes += end - offset
            offset = end + 1
        return offset

    def _whole_head(self) -> bool:
        return len(self._head) >= HEAD_LINES or self._head_bytes >= HEAD_BYTES

    def _spot_bytes(self) -> int:
        return max(_SPOT_BYTES, 4 * self._head_bytes // len(self._head))
