"""What is kept of a window for pictures that are drawn later, when its samples are gone: MV against
OP over a typical stretch, and the pictures of what was named. Some KB for each window.
"""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening_result import Screening
from stemwatch.service.report.charts.effect_pictures import Picture, effect_pictures
from stemwatch.service.report.charts.small_plot import Drawn, Note, SmallPlot
from stemwatch.service.report.charts.thinning import telling_samples
from stemwatch.service.report.charts.traces import packed, unpacked
from stemwatch.service.report.charts.typical_stretch import typical_stretch

VERSION = 1
LOOP_POINTS = 300
BEFORE, AFTER = "naive", "mv"  # classes of the style sheet


@dataclass(frozen=True)
class WindowLoop:
    """Points (m,) of MV against OP in their order, both in percent."""

    op: Floats
    mv: Floats


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowPictures:
    """``loop`` is ``None`` where there is no position; ``effects`` are empty where nothing was
    named."""

    loop: WindowLoop | None = None
    effects: tuple[Picture, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Whether the same is drawn: arrays are compared as they are stored."""
        return isinstance(other, WindowPictures) and pack_pictures(self) == pack_pictures(other)

    __hash__ = None  # type: ignore[assignment]


def window_pictures(screening: Screening) -> WindowPictures:
    """The pictures of a screening that still has its samples."""
    recording, mismatch = screening.recording, screening.mismatch
    return WindowPictures(
        loop=None if recording is None else _loop(screening, recording),
        effects=() if mismatch is None else effect_pictures(recording, mismatch),
    )


def _loop(screening: Screening, recording: Recording) -> WindowLoop | None:
    op, mv = recording.op, recording.mv
    if mv is None or mv.unit != op.unit or not (np.isfinite(op.values + mv.values)).any():
        return None
    stretch = typical_stretch(screening)
    part = slice(None) if stretch is None else slice(stretch.first, stretch.last)
    shown = [op.values[part], mv.values[part]]
    picked = telling_samples(shown, LOOP_POINTS)
    return WindowLoop(shown[0][picked], shown[1][picked])


def before_and_after(before: WindowLoop, after: WindowLoop) -> SmallPlot:
    """Both loops on the same axes."""
    return SmallPlot(
        x_label="OP, %",
        y_label="MV, %",
        spoken="MV against OP in the window before the work and in the latest one after it.",
        drawn=[
            Drawn(BEFORE, "before the work", before.op, before.mv, dashed=True),
            Drawn(AFTER, "after it", after.op, after.mv),
        ],
        equal=True,
        height=320,
    )


def pack_pictures(pictures: WindowPictures) -> bytes:
    """As bytes for the store; empty where there is nothing to draw."""
    if pictures.loop is None and not pictures.effects:
        return b""
    loop = pictures.loop
    plain = {
        "version": VERSION,
        "loop": None if loop is None else {"op": packed(loop.op), "mv": packed(loop.mv)},
        "effects": [_plain(picture) for picture in pictures.effects],
    }
    return zlib.compress(json.dumps(plain, separators=(",", ":"), allow_nan=False).encode(), 9)


def unpack_pictures(kept: bytes) -> WindowPictures:
    """The pictures of ``pack_pictures``; none where a newer version wrote them."""
    if not kept:
        return WindowPictures()
    plain = json.loads(zlib.decompress(kept))
    if plain["version"] != VERSION:
        return WindowPictures()
    loop = plain["loop"]
    return WindowPictures(
        loop=None if loop is None else WindowLoop(unpacked(loop["op"]), unpacked(loop["mv"])),
        effects=tuple(_picture(one) for one in plain["effects"]),
    )


def _plain(picture: Picture) -> dict[str, Any]:
    plot = picture.plot
    return {
        "title": picture.title,
        "says": picture.says,
        "x": plot.x_label,
        "y": plot.y_label,
        "spoken": plot.spoken,
        "notes": [[note.x, note.y, note.text] for note in plot.notes],
        "equal": plot.equal,
        "size": [plot.width, plot.height],
        "limits": plot.limits,
        "legend": plot.legend,
        "drawn": [
            {
                "kind": one.kind,
                "label": one.label,
                "x": packed(one.x),
                "y": packed(one.y),
                "dots": one.dots,
                "dashed": one.dashed,
            }
            for one in plot.drawn
        ],
    }


def _picture(plain: dict[str, Any]) -> Picture:
    limits: Sequence[float] | None = plain["limits"]
    plot = SmallPlot(
        x_label=plain["x"],
        y_label=plain["y"],
        spoken=plain["spoken"],
        notes=tuple(Note(*note) for note in plain["notes"]),
        equal=plain["equal"],
        width=plain["size"][0],
        height=plain["size"][1],
        limits=None if limits is None else (limits[0], limits[1], limits[2], limits[3]),
        legend=plain["legend"],
        drawn=tuple(
            Drawn(
                one["kind"],
                one["label"],
                unpacked(one["x"]),
                unpacked(one["y"]),
                dots=one["dots"],
                dashed=one["dashed"],
            )
            for one in plain["drawn"]
        ),
    )
    return Picture(title=plain["title"], plot=plot, says=plain["says"])
