"""What the product is made of: known vulnerabilities, licences, and a bill of materials.

    python -m tests.supply_chain --tools BIN [--out FOLDER]

``make supply-chain`` runs it. A vulnerability that is known, and a licence that the product cannot
be delivered under, are failures. What could not be looked up is said, loudly, and fails nothing: a
network that reaches no vulnerability service is no fault of a change. The bill of materials
(CycloneDX) lists what ``requirements.lock`` installs, with the hashes.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BILL = "stemwatch.cdx.json"
# Delivered beside a program under Apache-2.0: none that asks for the program's own source.
_REFUSED = re.compile(r"\b(?:A?GPL|SSPL|BUSL)\b|(?<!Lesser )General Public License|Affero", re.I)
# Packages that state no licence but in a file of theirs, with the licence read there.
_READ = {"FMPy": "BSD-2-Clause"}
_LESSER = re.compile(r"\bLGPL|Lesser General Public|Library General Public", re.I)


@dataclass(frozen=True)
class Looked:
    """What the look-up of vulnerabilities gave."""

    found: Sequence[str]
    looked_up: int
    not_looked_up: Mapping[str, str]  # package or "all": why

    def sentences(self) -> list[str]:
        """One for each thing that somebody should know."""
        sentences = [f"VULNERABLE: {item}" for item in self.found]
        if self.not_looked_up:
            name, why = next(iter(self.not_looked_up.items()))
            sentences.append(
                f"NOT LOOKED UP: the vulnerabilities of {len(self.not_looked_up)} packages "
                f"({name}: {why}). Nothing is known of them; look again where a vulnerability "
                "service can be reached"
            )
        sentences.append(f"{self.looked_up} packages were looked up, {len(self.found)} findings.")
        return sentences


def look_up(answer: str, text: str, packages: int) -> Looked:
    """What pip-audit's JSON ``answer`` says of ``packages`` packages, and where there is none, what
    it ``said`` instead."""
    try:
        entries = json.loads(answer)["dependencies"]
    except (ValueError, KeyError, TypeError):
        why = next((line for line in reversed(text.splitlines()) if line.strip()), "no answer")
        return Looked([], 0, {f"package {n + 1}": why for n in range(packages)})
    skipped = {entry["name"]: entry["skip_reason"] for entry in entries if "skip_reason" in entry}
    matching = [
        f"{entry['name']} {entry['version']}: {known['id']}, mended in "
        f"{', '.join(known['fix_versions']) or 'no version yet'}"
        for entry in entries
        for known in entry.get("vulns", ())
    ]
    return Looked(matching, len(entries) - len(skipped), skipped)


def refused_licences(licences: Mapping[str, str]) -> list[str]:
    """Packages whose licence is not known or asks for the source of what it is delivered with."""
    sentences = []
    for name, licence in sorted(licences.items()):
        # "GPL or MIT" may be taken as MIT.
        choices = re.split(r"\s+OR\s+|;", licence)
        if not licence.strip() or licence.strip().upper() == "UNKNOWN":
            sentences.append(f"{name}: no licence is stated")
        elif all(_REFUSED.search(choice) and not _LESSER.search(choice) for choice in choices):
            sentences.append(f"{name}: {licence}")
    return sentences


def _answer(command: Sequence[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)


def _vulnerabilities(tools: Path) -> Looked:
    lock = ROOT / "requirements-dev.lock"
    packages = len(re.findall(r"^[a-z0-9]", lock.read_text(encoding="utf-8"), re.M))
    command = [str(tools / "pip-audit"), "-r", str(lock), "--disable-pip", "--require-hashes",
               "--format", "json", "--progress-spinner", "off", "--timeout", "10"]  # fmt: skip
    result = _answer(command)
    return look_up(result.stdout, result.stderr, packages)


def _licences(tools: Path) -> dict[str, str]:
    command = [str(tools / "pip-licenses"), "--python", sys.executable, "--from=mixed"]
    result = _answer([*command, "--format=json"])
    if result.returncode:
        raise SystemExit(f"pip-licenses failed: {result.stderr}")
    stated = {load["Name"]: load["License"] for load in json.loads(result.stdout)}
    return stated | {name: _READ[name] for name in stated.keys() & _READ.keys()}


def _write_bill(tools: Path, folder: Path) -> int:
    """The bill of materials; how many parts it has."""
    folder.mkdir(parents=True, exist_ok=True)
    command = [str(tools / "cyclonedx-py"), "requirements", "requirements.lock", "--pyproject"]
    options = ["--output-reproducible", "--of", "JSON", "--output-file", str(folder / BILL)]
    result = _answer([*command, "pyproject.toml", *options])
    if result.returncode:
        raise SystemExit(f"cyclonedx-py failed: {result.stderr}")
    return len(json.loads((folder / BILL).read_text(encoding="utf-8"))["components"])


def main() -> None:
    """Run all three; the exit status is 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tools", type=Path, required=True, help="folder with their programs")
    parser.add_argument("--out", type=Path, default=ROOT / "dist")
    arguments = parser.parse_args()
    tools = arguments.tools.absolute()
    looked = _vulnerabilities(tools)
    print("\n".join(looked.sentences()))
    licences = _licences(tools)
    refused = refused_licences(licences)
    print("\n".join(f"LICENCE: {item}" for item in refused))
    print(f"{len(licences)} licences were read, {len(refused)} refused.")
    parts = _write_bill(tools, arguments.out)
    print(f"{parts} parts are in {arguments.out / BILL}")
    sys.exit(bool(looked.found or refused))


if __name__ == "__main__":
    main()
