"""A network as safetensors bytes: the arrays, and the other fields as JSON in the header."""

from __future__ import annotations

import hashlib
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from stemwatch.models.narx.architecture import FORMAT_VERSION, NO_ACTUATOR
from stemwatch.models.recording import Floats

# A single metadata key: safetensors writes several in no fixed order, and equal networks should
# give equal bytes.
_KEY = "stemwatch.narx"
_LENGTH_BYTES = 8  # a safetensors file begins with the length of its JSON header


def pack(facts: Mapping[str, Any], weights: Mapping[str, Floats]) -> bytes:
    """A network's arrays and its other fields (as JSON) as bytes, with a digest to
    detect damage.
    """
    from safetensors.numpy import save

    arrays = dict(weights)
    signed = {**facts, "digest": _digest(facts, arrays)}
    return bytes(save(arrays, metadata={_KEY: json.dumps(signed, sort_keys=True)}))


def unpack(data: bytes) -> tuple[dict[str, Any], dict[str, Floats]]:
    """The arguments of ``pack``, converted to this version; ``ValueError`` with a sentence for
    other bytes.
    """
    facts = _facts(data)
    version = facts.get("format_version")
    if version not in (1, FORMAT_VERSION):
        raise ValueError(
            f"NARX network of format version {version!r}: this release reads versions up to "
            f"{FORMAT_VERSION}; train the valve's network again, or use the release that wrote it"
        )
    weights = _weights(data)
    stored = facts.pop("digest", None)
    if stored != _digest(facts, weights):
        raise ValueError(
            "NARX network is damaged: its numbers do not match the digest stored with them; "
            "restore it from a backup or train the valve's network again"
        )
    if version == 1:
        facts, weights = _of_this_version(facts, weights)
    facts["ranges"] = {name: (pair[0], pair[1]) for name, pair in facts["ranges"].items()}
    return facts, weights


def _of_this_version(
    facts: dict[str, Any], weights: dict[str, Floats]
) -> tuple[dict[str, Any], dict[str, Floats]]:
    """A network of version 1, which had no actuator and no fourth input."""
    new = dict(weights)
    for name in ("hidden", "value"):  # the fourth input stands before the bias
        new[name] = np.insert(weights[name], -1, 0.0, axis=-1)
    return facts | {"format_version": FORMAT_VERSION, "actuator": dict(NO_ACTUATOR)}, new


def _facts(data: bytes) -> dict[str, Any]:
    """The fields in the header. Read here because the library returns arrays only."""
    try:
        (length,) = struct.unpack_from("<Q", data)
        header = json.loads(data[_LENGTH_BYTES : _LENGTH_BYTES + length])
        facts = json.loads(header["__metadata__"][_KEY])
    except (struct.error, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(
            f"{len(data)} bytes are not a stored NARX network: the header that names its lags and "
            "scaling cannot be read; restore it from a backup or train the network again"
        ) from error
    if not isinstance(facts, dict):
        raise ValueError(f"NARX network header: an object expected, received {facts!r:.80}")
    return facts


def _weights(data: bytes) -> dict[str, Floats]:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return dict(load(data))
    except SafetensorError as error:
        raise ValueError(
            f"NARX network is damaged: {error}; restore it from a backup or train it again"
        ) from error


def _digest(facts: Mapping[str, object], weights: Mapping[str, Floats]) -> str:
    digest = hashlib.sha256(json.dumps(facts, sort_keys=True).encode())
    for name in sorted(weights):
        digest.update(f"{name}{weights[name].shape}".encode())
        digest.update(np.ascontiguousarray(weights[name]).tobytes())
    return digest.hexdigest()
