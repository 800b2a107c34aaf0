"""The package as a plant gets it: what is in the wheel, what it installs, what it must not hold."""

from __future__ import annotations

import json
import multiprocessing
import os
import re
import shutil
import subprocess
import sys
import zipfile
from concurrent.futures import ProcessPoolExecutor
from importlib.metadata import EntryPoint, distribution, entry_points, version
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent
FOLDERS = ("service", "connectors", "models")
FRONT = [
    f"stemwatch/{path.name}"
    for path in (REPOSITORY / "stemwatch").iterdir()
    if path.is_file() and path.suffix != ".pyc"
]
HEAVY = ("numpy", "pandas", "torch", "scipy", "numba", "matplotlib", "sqlalchemy", "xlsxwriter")
# Written in pieces, so that this file does not hold what it looks for.
REGISTRIES = (
    "py" + "pi.org",
    "python" + "hosted.org",
    "download.py" + "torch.org",
    "npm" + "js.org",
)
MACHINE_PATH = re.compile(r"(?<![\w.$/{])/(?:wo" + r"rk|fa" + r"rm|ro" + r"ot|ho" + r"me)/")
CONNECTORS = tuple(entry_points(group="stemwatch.connectors"))


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean copy of what the package is built from, with its links as links."""
    return _copied(tmp_path_factory.mktemp("sources"))


@pytest.fixture(scope="module")
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel that pip builds from a clean copy of the sources."""
    return _wheel(sources, tmp_path_factory.mktemp("wheel"))


def test_the_wheel_holds_every_file_of_the_three_folders(wheel: zipfile.ZipFile) -> None:
    """Pages, styles, schemas, migrations and type marks travel with the code, once each, and
    nothing else."""
    expected = sorted(FRONT + [f"stemwatch/{path.as_posix()}" for path in _package_files()])
    in_order = sorted(name for name in wheel.namelist() if ".dist-info/" not in name)
    assert expected == in_order


@pytest.mark.long
def test_a_source_archive_makes_the_same_wheel(
    sources: Path, wheel: zipfile.ZipFile, tmp_path: Path
) -> None:
    """Whoever builds from the source archive installs what we install."""
    code = f"import setuptools.build_meta as b; b.build_sdist({str(tmp_path)!r})"
    process = _python("-c", code, cwd=_copied(tmp_path / "for-the-archive"))
    assert process.returncode == 0, process.stderr
    (archive,) = tmp_path.glob("*.tar.gz")
    shutil.unpack_archive(archive, tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    assert _contents(wheel) == _contents(_wheel(unpacked, tmp_path / "again"))


@pytest.mark.long
def test_a_checkout_without_links_makes_the_same_wheel(
    wheel: zipfile.ZipFile, tmp_path: Path
) -> None:
    """Where links may not be made, as on many Windows computers, git writes small text files in
    their places; the package is the same."""
    source = _copied(tmp_path / "source")
    for folder in FOLDERS:
        link = source / "stemwatch" / folder
        target = link.readlink()
        link.unlink()
        link.write_text(target.as_posix(), "utf-8")
    assert _contents(wheel) == _contents(_wheel(source, tmp_path / "wheel"))


@pytest.mark.parametrize("folder", FOLDERS)
def test_a_plain_checkout_shows_editors_the_packages(folder: str) -> None:
    """``stemwatch/models`` and its neighbours are links that hold wherever the checkout lies."""
    assert (REPOSITORY / "stemwatch" / folder).readlink().as_posix() == f"../{folder}"


def test_the_tests_run_the_package_that_is_installed() -> None:
    """A normal installation is what the tests see, here and in the processes that they start; only
    an editable one leads into the checkout."""
    loaded = json.loads(distribution("stemwatch").read_text("direct_url.json") or "{}")
    editable = loaded.get("dir_info", {}).get("editable", False)
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as workers:
        matching = [_place_of_the_package(), workers.submit(_place_of_the_package).result()]
    checkout = (REPOSITORY / "stemwatch").resolve()
    assert [editable] * 2 == [index == checkout for index in matching]


def _place_of_the_package() -> Path:
    import stemwatch

    return Path(stemwatch.__file__).resolve().parent


def test_importing_the_package_loads_no_heavy_library(tmp_path: Path) -> None:
    """``import stemwatch`` answers at once: what it needs is loaded when it is used."""
    code = f"import sys, stemwatch; print([n for n in {HEAVY} if n in sys.modules])"
    process = _python("-c", code, cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert process.stdout.strip() == "[]"


def test_every_kind_of_file_the_product_needs_is_among_them(wheel: zipfile.ZipFile) -> None:
    """The list above is not empty by accident: each kind has at least one file in the wheel."""
    kinds = {Path(name).suffix for name in wheel.namelist()}
    assert {".py", ".html", ".css", ".js", ".json", ".mako", ".ttf", ".typed"} <= kinds


def test_the_wheel_carries_the_licences(wheel: zipfile.ZipFile) -> None:
    """Our licence and that of the chart library go wherever the wheel goes."""
    names = wheel.namelist()
    assert any(name.endswith("licenses/LICENSE") for name in names)
    assert "stemwatch/service/report/scripts/vendor/uPlot-LICENSE.txt" in names
    assert "stemwatch/service/maintenance/fonts/DejaVu-LICENSE.txt" in names


def test_the_command_is_an_entry_point_that_loads() -> None:
    """``stemwatch`` is a console command of the installed package."""
    (script,) = entry_points(group="console_scripts", name="stemwatch")
    assert callable(script.load())


@pytest.mark.parametrize("entry", CONNECTORS, ids=lambda entry: entry.name)
def test_an_installed_connector_loads_and_keeps_the_seam(entry: EntryPoint) -> None:
    """Each entry point of ``stemwatch.connectors`` is a class with ``tags`` and ``read``."""
    connector = entry.load()
    assert callable(connector.tags)
    assert callable(connector.read)


def test_there_is_a_connector_for_files() -> None:
    """A fresh installation can read exported files."""
    assert "csv" in {entry.name for entry in CONNECTORS}


def test_the_changelog_begins_with_this_version() -> None:
    """The newest released heading of CHANGELOG.md is the version that is installed."""
    text = (REPOSITORY / "CHANGELOG.md").read_text("utf-8")
    newest = re.search(r"^## \[?(\d[^\]\s]*)", text, re.MULTILINE)
    assert newest is not None
    assert newest[1] == version("stemwatch")


@pytest.mark.long
@pytest.mark.parametrize("command", ["console script", "module"])
def test_help_is_printed_outside_the_repository(command: str, tmp_path: Path) -> None:
    """``stemwatch --help`` and ``python -m stemwatch.service --help`` run from any folder."""
    if command == "module":
        done = _python("-m", "stemwatch.service", "--help", cwd=tmp_path)
    else:
        script = shutil.which("stemwatch", path=str(Path(sys.executable).parent))
        assert script is not None
        done = _run([script, "--help"], tmp_path)
    assert done.returncode == 0, done.stderr
    assert "screen" in done.stdout


def test_the_command_line_loads_no_heavy_library(tmp_path: Path) -> None:
    """``--help`` answers at once: tables, networks and databases are loaded when they are used."""
    code = f"import sys, stemwatch.service.cli; print([n for n in {HEAVY} if n in sys.modules])"
    process = _python("-c", code, cwd=tmp_path)
    assert process.returncode == 0, process.stderr
    assert process.stdout.strip() == "[]"


def test_no_file_names_a_machine_or_a_package_registry() -> None:
    """The repository installs anywhere, from whatever index its user has chosen."""
    named = []
    for path in _repository_files():
        text = path.read_text("utf-8", errors="replace")
        if MACHINE_PATH.search(text) or any(host in text for host in REGISTRIES):
            named.append(str(path.relative_to(REPOSITORY)))
    assert named == []


def test_every_dependency_is_pinned() -> None:
    """What pyproject.toml asks for stands in constraints.txt with one exact version."""
    import tomllib

    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text("utf-8"))
    requested = project["project"]["dependencies"] + project["dependency-groups"]["dev"]
    lines = (REPOSITORY / "constraints.txt").read_text("utf-8").splitlines()
    pins = [line for line in lines if line and not line.startswith("#")]
    assert [pin for pin in pins if not re.fullmatch(r"[\w.-]+==[\w.]+", pin)] == []
    pinned = {_plain(pin) for pin in pins}
    assert [name for name in requested if _plain(name) not in pinned] == []


def _plain(requirement: str) -> str:
    """The name of a requirement, in the spelling that all spellings of it share."""
    return re.split(r"[\[<>=~!; ]", requirement)[0].lower().replace("_", "-")


def _package_files() -> list[Path]:
    result = (path for folder in FOLDERS for path in (REPOSITORY / folder).rglob("*"))
    return [
        path.relative_to(REPOSITORY)
        for path in result
        if path.is_file() and "__pycache__" not in path.parts
    ]


def _copied(source: Path) -> Path:
    ignored = shutil.ignore_patterns("__pycache__")
    for name in ("stemwatch", *FOLDERS):
        shutil.copytree(REPOSITORY / name, source / name, ignore=ignored, symlinks=True)
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(REPOSITORY / name, source / name)
    return source


def _wheel(source: Path, folder: Path) -> zipfile.ZipFile:
    build = ["-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    process = _python(*build, "--wheel-dir", str(folder), str(source), cwd=source)
    assert process.returncode == 0, process.stderr
    (built,) = folder.glob("*.whl")
    return zipfile.ZipFile(built)


def _contents(wheel: zipfile.ZipFile) -> dict[str, int]:
    """Every file with the checksum of its bytes; what describes the build itself apart."""
    entries = (entry for entry in wheel.infolist() if not entry.filename.endswith("/RECORD"))
    return {entry.filename: entry.CRC for entry in entries}


def _repository_files() -> list[Path]:
    """What git has or would add; without git, what lies in the folders of the project."""
    listing = _run(["git", "ls-files", "-co", "--exclude-standard"], REPOSITORY)
    if listing.returncode == 0:
        result = [REPOSITORY / name for name in listing.stdout.splitlines()]
    else:
        folders = ("stemwatch", *FOLDERS, "tests", "docs", "deploy", ".ci")
        result = [path for folder in folders for path in (REPOSITORY / folder).rglob("*")]
        result += REPOSITORY.glob("*.*")
    return [path for path in result if path.is_file() and "__pycache__" not in path.parts]


def _python(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return _run([sys.executable, *arguments], cwd)


def _run(command: list[str], cwd: Path) -> subprocess.CompletedProcess[str]:
    # Rich draws help in the width of the terminal, and colours it where it thinks it may.
    environment = os.environ | {"NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "200"}
    return subprocess.run(
        command,
        cwd=cwd,
        capture_output=True,
        text=True,
        encoding="utf-8",
        stdin=subprocess.DEVNULL,
        env=environment,
        check=False,
    )
