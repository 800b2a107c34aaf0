"""The fitted valve for other simulators: a Functional Mock-up Unit (FMI 3.0) and a Modelica text.

The C sources, the descriptions and the Modelica text stand in this folder; what differs from valve
to valve are the numbers in ``start_values.h`` and their copies in the descriptions.
"""

from __future__ import annotations

import hashlib
import io
import os
import platform
import re
import shutil
import subprocess
import tempfile
import zipfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from stemwatch.models.mismatch.open_question import SLOW
from stemwatch.models.valve_chain import CHAIN_PARAMETERS, ValveChain
from stemwatch.service import __version__
from stemwatch.service.presenter.physics_words import effect_name

SOURCES = Path(__file__).parent
COMPILERS = ("cc", "gcc", "clang")
OPTIONS = ("-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared", "-fvisibility=hidden")
LONGEST_COMPILATION_S = 120.0
_LONGEST_NAME = 64
# Words that Modelica has for itself (language specification 3.6, section 2.3.3, and its types).
_MODELICA = re.compile(
    "algorithm|and|annotation|block|break|class|connect|connector|constant|constrainedby|der|"
    "discrete|each|else|elseif|elsewhen|encapsulated|end|enumeration|equation|expandable|extends|"
    "external|false|final|flow|for|function|if|import|impure|in|initial|inner|input|loop|model|"
    "not|operator|or|outer|output|package|parameter|partial|protected|public|pure|record|"
    "redeclare|replaceable|return|stream|then|true|type|when|while|within|"
    "Boolean|Clock|Integer|Real|String"
)
# The names of FMI 3.0 for this machine and its system, and the ending of a shared library.
_MACHINES = {"x86_64": "x86_64", "amd64": "x86_64", "aarch64": "aarch64", "arm64": "aarch64"}
_SYSTEMS = {"linux": "linux", "darwin": "darwin", "windows": "windows"}
_ENDINGS = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}
_DATE = (1980, 1, 1, 0, 0, 0)  # of every file in the archive, so that the same valve gives the same


@dataclass(frozen=True, kw_only=True)
class MadeUnit:
    """The bytes of an ``.fmu``, and why it has no ``binary`` where it has none."""

    content: bytes
    no_binary: str = ""


def identifier_of(valve: str) -> str:
    """A name for C, Modelica and files: letters, digits and underscores, no word of Modelica."""
    name = re.sub(r"\W+", "_", valve, flags=re.ASCII).strip("_")[:_LONGEST_NAME]
    taken = not name or name[0].isdigit() or _MODELICA.fullmatch(name)
    return f"valve_{name}".rstrip("_") if taken else name


def contents_in_words(chain: ValveChain) -> str:
    """What the model has of the valve."""
    has = ", ".join(["S and J", *map(effect_name, chain.named)])
    said = f"It has {has}" + (" and the curve from OP to stroke." if chain.curve else ".")
    if SLOW & {*chain.named}:
        said += (
            f" What changes with time does so over the first {chain.values['record_time']:g} s, "
            "the length of the recording, and then stays as it is."
        )
    return said


def functional_mockup_unit(chain: ValveChain, compiler: str | None = None) -> MadeUnit:
    """The valve as FMI 3.0 for co-simulation: sources, descriptions, documentation, and the binary
    for this machine where ``compiler`` (or cc, gcc or clang) is there."""
    texts = _rendered(chain)
    files = {
        "modelDescription.xml": texts["modelDescription.xml"],
        "documentation/index.html": texts["index.html"],
        "sources/buildDescription.xml": texts["buildDescription.xml"],
        "sources/start_values.h": texts["start_values.h"],
        "sources/valve.h": (SOURCES / "valve.h").read_bytes(),
        "sources/fmi3.c": (SOURCES / "fmi3.c").read_bytes(),
    }
    sources = {name: data for name, data in files.items() if name.startswith("sources/")}
    binary = _compiled(sources, compiler)
    if not isinstance(binary, str):
        folder, ending = _platform()
        files[f"binaries/{folder}/{identifier_of(chain.valve)}{ending}"] = binary
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, _DATE), data, zipfile.ZIP_DEFLATED)
    return MadeUnit(content=packed.getvalue(), no_binary=binary if isinstance(binary, str) else "")


def modelica_text(chain: ValveChain) -> str:
    """The valve as a Modelica block, with the numbers of its fit as parameters."""
    return _environment(escapes=False).get_template("valve.mo").render(_context(chain))


def _rendered(chain: ValveChain) -> dict[str, bytes]:
    """The files that differ from valve to valve; the token is made of the numbers."""
    context = _context(chain)
    plain, escaped = _environment(escapes=False), _environment(escapes=True)
    numbers = plain.get_template("start_values.h").render(context, token="")
    of_this = f"{__version__}{chain.valve}{numbers}".encode("utf-8", "backslashreplace")
    token = "{" + hashlib.sha256(of_this).hexdigest() + "}"
    rendered = {"start_values.h": plain.get_template("start_values.h").render(context, token=token)}
    for name in ("modelDescription.xml", "buildDescription.xml", "index.html"):
        rendered[name] = escaped.get_template(name).render(context, token=token)
    return {name: text.encode() for name, text in rendered.items()}


def _context(chain: ValveChain) -> dict[str, Any]:
    return {
        "chain": chain,
        # Without signs that neither XML nor a terminal can hold.
        "valve": "".join(sign if sign.isprintable() else " " for sign in chain.valve),
        "identifier": identifier_of(chain.valve),
        "values": chain.values,
        "parameters": [
            {**vars(parameter), "value": chain.values[parameter.name]}
            for parameter in CHAIN_PARAMETERS
        ],
        "curve_op": () if chain.curve is None else chain.curve.op,
        "curve_travel": () if chain.curve is None else chain.curve.travel,
        "sentence": contents_in_words(chain),
        "tool": f"stemwatch {__version__}",
    }


def _environment(*, escapes: bool) -> Environment:
    environment = Environment(
        loader=FileSystemLoader(SOURCES),
        autoescape=escapes,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["exact"] = lambda number: repr(float(number))
    environment.filters["in_string"] = _in_string
    return environment


def _in_string(text: str) -> str:
    """``text`` between the quotation marks of Modelica."""
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _platform() -> tuple[str, str]:
    machine, system = platform.machine().lower(), platform.system().lower()
    name = f"{_MACHINES.get(machine, machine)}-{_SYSTEMS.get(system, system)}"
    return name, _ENDINGS.get(system, ".so")


def _compiled(sources: dict[str, bytes], compiler: str | None) -> bytes | str:
    """The shared library, or why there is none."""
    wanted = [compiler] if compiler else [os.environ.get("CC", ""), *COMPILERS]
    found = next((path for path in map(shutil.which, filter(None, wanted)) if path), None)
    if found is None:
        return (
            f"there is no C compiler here ({', '.join(filter(None, wanted))}); most tools compile "
            "the sources in it themselves"
        )
    with tempfile.TemporaryDirectory(prefix="stemwatch-") as folder:
        for name, data in sources.items():
            (Path(folder) / Path(name).name).write_bytes(data)
        library = Path(folder) / f"valve{_platform()[1]}"
        command = [found, *OPTIONS, "fmi3.c", "-o", str(library), "-lm"]
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                capture_output=True,
                text=True,
                check=False,
                timeout=LONGEST_COMPILATION_S,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return f"{found} did not compile it: {error}"
        if done.returncode or not library.exists():
            said = (done.stderr.strip().splitlines() or [f"exit status {done.returncode}"])[0]
            return f"{found} did not compile it: {said}"
        return library.read_bytes()
