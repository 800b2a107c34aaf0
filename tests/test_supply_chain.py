"""The lock files hold what is tested, with hashes; what could not be looked up is said."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest

from tests.supply_chain import look_up, refused_licences

ROOT = Path(__file__).resolve().parent.parent
LOCKS = ("requirements.lock", "requirements-dev.lock")


def plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def locked(name: str) -> dict[str, tuple[str, list[str]]]:
    """Version and hashes of each package of a lock file."""
    text = (ROOT / name).read_text(encoding="utf-8").replace("\\\n", " ")
    results = {}
    for line in text.splitlines():
        package, _, rest = line.partition("==")
        results[plain(package.split("[")[0])] = (
            rest.split()[0],
            re.findall(r"--hash=sha256:([0-9a-f]{64})(?!\S)", line),
        )
    return results


def pinned() -> dict[str, str]:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pairs = (line.split("==") for line in lines if "==" in line and not line.startswith("#"))
    return {plain(name): version for name, version in pairs}


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_file_has_the_tested_versions_with_hashes(name: str) -> None:
    """`make lock` was run after the last change of a version."""
    versions = pinned()
    for package, (version, hashes) in locked(name).items():
        assert hashes, f"{package} has no hash: run make lock"
        assert versions.get(package, version) == version, f"{package}: run make lock"


def test_everything_the_project_asks_for_is_locked() -> None:
    """Also what only the checks need, in their own file."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"].values()
    product = [*project["project"]["dependencies"], *(item for extra in extras for item in extra)]
    names = {plain(re.split(r"[\[<>=~! ]", item)[0]) for item in product}
    checks = {
        plain(re.split(r"[\[<>=~! ]", item)[0]) for item in project["dependency-groups"]["dev"]
    }
    assert names <= locked("requirements.lock").keys()
    assert names | checks <= locked("requirements-dev.lock").keys()


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_file_names_no_index(name: str) -> None:
    """Any mirror of the package index will do."""
    text = (ROOT / name).read_text(encoding="utf-8")
    assert "://" not in text
    assert "--index" not in text


def test_what_was_not_looked_up_is_said_and_is_no_finding() -> None:
    """A service that is not reached, or does not know the packages, is not "all is well"."""
    silent = look_up("", "ERROR: no connection to the service\n", 3)
    assert (silent.looked_up, list(silent.found)) == (0, [])
    assert "NOT LOOKED UP: the vulnerabilities of 3 packages" in silent.sentences()[0]
    assert "no connection to the service" in silent.sentences()[0]
    entries = [
        {"name": "one", "skip_reason": "not found"},
        {"name": "two", "version": "1.0", "vulns": []},
    ]
    partly = look_up(json.dumps({"dependencies": entries}), "", 2)
    assert partly.looked_up == 1
    assert "of 1 packages (one: not found)" in partly.sentences()[0]


def test_a_known_vulnerability_is_a_finding() -> None:
    """With what to do."""
    vulnerable = {"id": "CVE-1", "fix_versions": ["1.1"]}
    entries = [{"name": "two", "version": "1.0", "vulns": [vulnerable]}]
    looked = look_up(json.dumps({"dependencies": entries}), "", 1)
    assert looked.found == ["two 1.0: CVE-1, mended in 1.1"]
    assert looked.sentences()[0] == "VULNERABLE: two 1.0: CVE-1, mended in 1.1"


def test_licences_that_ask_for_our_source_or_say_nothing_are_refused() -> None:
    """LGPL libraries may be used as they are; of two licences one may be chosen."""
    licences = {
        "a": "MIT", "b": "GPL-3.0-only", "c": "UNKNOWN", "d": "LGPL-3.0-only",
        "e": "GNU Affero General Public License v3", "f": "GPL-2.0-only OR MIT",
        "g": "GNU Lesser General Public License v3 or later (LGPLv3+)",
    }  # fmt: skip
    assert [refused_licence.split(":")[0] for refused_licence in refused_licences(licences)] == [
        "b",
        "c",
        "e",
    ]
