"""The pictures kept of a window for when its samples are gone: MV against OP over a typical
stretch, and the pictures of named effects and of a suspicion from OP and PV. Some KB for each
window."""

from __future__ import annotations

import json
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from stemwatch.models.recording import Floats, Recording
from stemwatch.models.screening_result import Screening
from stemwatch.service.report.charts.effect_pictures import effect_pictures
from stemwatch.service.report.charts.small_plot import Note, Picture, PlottedLine, SmallPlot
from stemwatch.service.report.charts.suspicion_pictures import suspicion_pictures
from stemwatch.service.report.charts.thinning import extreme_samples
from stemwatch.service.report.charts.traces import packed, unpacked
from stemwatch.service.report.charts.typical_stretch import typical_stretch
from stemwatch.service.report.charts.valve_charts import suspected_element

VERSION = 2  # the first held the steps of its lines as lists
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
    named, ``suspicion`` where OP and PV alone raise none."""

    loop: WindowLoop | None = None
    effects: tuple[Picture, ...] = ()
    suspicion: tuple[Picture, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Whether the same is drawn: arrays are compared as they are stored."""
        return isinstance(other, WindowPictures) and pack_pictures(self) == pack_pictures(other)

    __hash__ = None  # type: ignore[assignment]


def window_pictures(screening: Screening) -> WindowPictures:
    """The pictures of a screening that still has its samples."""
    recording, mismatch = screening.recording, screening.mismatch
    if recording is None:
        return WindowPictures()
    element = suspected_element(screening)
    return WindowPictures(
        loop=_loop(screening, recording),
        effects=() if mismatch is None else effect_pictures(recording, mismatch),
        suspicion=() if element is None else suspicion_pictures(recording, element),
    )


def _loop(screening: Screening, recording: Recording) -> WindowLoop | None:
    op, mv = recording.op, recording.mv
    if mv is None or mv.unit != op.unit or not (np.isfinite(op.values + mv.values)).any():
        return None
    stretch = typical_stretch(screening)
    part = slice(None) if stretch is None else slice(stretch.first, stretch.last)
    signals = [op.values[part], mv.values[part]]
    kept_samples = extreme_samples(signals, LOOP_POINTS)
    return WindowLoop(signals[0][kept_samples], signals[1][kept_samples])


def before_and_after(before: WindowLoop, after: WindowLoop) -> SmallPlot:
    """Both loops on the same axes."""
    return SmallPlot(
        x_label="OP, %",
        y_label="MV, %",
        description="MV against OP in the window before the work and in the latest one after it.",
        lines=[
            PlottedLine(BEFORE, "before the work", before.op, before.mv, dashed=True),
            PlottedLine(AFTER, "after it", after.op, after.mv),
        ],
        equal=True,
        height=320,
    )


def pack_pictures(pictures: WindowPictures) -> bytes:
    """As bytes for the store; empty where there is nothing to draw."""
    if pictures.loop is None and not pictures.effects and not pictures.suspicion:
        return b""
    loop = pictures.loop
    as_json = {
        "version": VERSION,
        "loop": None if loop is None else {"op": packed(loop.op), "mv": packed(loop.mv)},
        "effects": [_picture_as_json(picture) for picture in pictures.effects],
        "suspicion": [_picture_as_json(picture) for picture in pictures.suspicion],
    }
    return zlib.compress(json.dumps(as_json, separators=(",", ":"), allow_nan=False).encode(), 9)


def unpack_pictures(packed_bytes: bytes) -> WindowPictures:
    """The pictures of ``pack_pictures``; none where a newer version wrote them."""
    if not packed_bytes:
        return WindowPictures()
    as_json = json.loads(zlib.decompress(packed_bytes))
    if as_json["version"] > VERSION:
        return WindowPictures()
    loop = as_json["loop"]
    return WindowPictures(
        loop=None if loop is None else WindowLoop(unpacked(loop["op"]), unpacked(loop["mv"])),
        effects=tuple(_picture(picture) for picture in as_json["effects"]),
        # Windows of earlier versions have none.
        suspicion=tuple(_picture(picture) for picture in as_json.get("suspicion", ())),
    )


def _picture_as_json(picture: Picture) -> dict[str, Any]:
    plot = picture.plot
    return {
        "title": picture.title,
        "says": picture.caption,
        "x": plot.x_label,
        "y": plot.y_label,
        "spoken": plot.description,
        "notes": [[note.x, note.y, note.text] for note in plot.notes],
        "equal": plot.equal,
        "size": [plot.width, plot.height],
        "limits": plot.limits,
        "legend": plot.legend,
        "drawn": [
            {
                "kind": line.kind,
                "label": line.label,
                "x": packed(line.x),
                "y": packed(line.y),
                "dots": line.dots,
                "dashed": line.dashed,
            }
            for line in plot.lines
        ],
    }


def _picture(as_json: dict[str, Any]) -> Picture:
    limits: Sequence[float] | None = as_json["limits"]
    plot = SmallPlot(
        x_label=as_json["x"],
        y_label=as_json["y"],
        description=as_json["spoken"],
        notes=tuple(Note(*note) for note in as_json["notes"]),
        equal=as_json["equal"],
        width=as_json["size"][0],
        height=as_json["size"][1],
        limits=None if limits is None else (limits[0], limits[1], limits[2], limits[3]),
        legend=as_json["legend"],
        lines=tuple(
            PlottedLine(
                line["kind"],
                line["label"],
                unpacked(line["x"]),
                unpacked(line["y"]),
                dots=line["dots"],
                dashed=line["dashed"],
            )
            for line in as_json["drawn"]
        ),
    )
    return Picture(title=as_json["title"], plot=plot, caption=as_json["says"])
