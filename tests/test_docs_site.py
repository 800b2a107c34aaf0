"""The docs as a site: every page is on it, and no link leads off it."""

from __future__ import annotations

import importlib.util
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")


@pytest.fixture(scope="module")
def site() -> ModuleType:
    """The hooks of the site, which need MkDocs only when they build."""
    spec = importlib.util.spec_from_file_location("docs_site", DOCS / "site.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_page_is_on_the_site_once(site: ModuleType) -> None:
    """The README's list names each page of docs once, and only pages that there are."""
    assert sorted(site.listed()) == sorted(page.name for page in DOCS.glob("*.md"))


def test_no_link_leads_off_the_site(site: ModuleType) -> None:
    """After the hooks each link of each page is one to a page, a picture or a copy on the site."""
    on_site = {str(file.relative_to(DOCS)) for file in DOCS.rglob("*")} | set(site.BESIDE.values())
    pages = {page.name: page for page in DOCS.glob("*.md")}
    pages |= {name: ROOT / place for place, name in site.BESIDE.items() if name.endswith(".md")}
    assert len(pages) > 30
    for name, page in pages.items():
        file = SimpleNamespace(file=SimpleNamespace(src_uri=name))
        result = site.on_page_markdown(page.read_text("utf-8"), page=file)
        without_code = re.sub(r"```.*?```|`[^`\n]*`", "", result, flags=re.DOTALL)
        links = [link for link, _ in LINK.findall(without_code) if "://" not in link]
        assert [link for link in links if link not in on_site] == [], name
    for index in site.BESIDE:
        assert (ROOT / index).is_file()


def test_the_site_builds_without_a_warning_and_loads_nothing_from_outside(tmp_path: Path) -> None:
    """With MkDocs where it is installed, strictly; no page fetches from another machine."""
    if importlib.util.find_spec("mkdocs") is not None:
        program = [sys.executable, "-m", "mkdocs"]
    else:
        own = ROOT / ".venv" / "site" / "bin" / "mkdocs"
        if not (result := shutil.which("mkdocs") or (str(own) if own.is_file() else None)):
            pytest.skip("MkDocs is not installed: THE SITE OF THE DOCS IS NOT BUILT (make docs)")
        program = [result]
    built = subprocess.run(
        [*program, "build", "--strict", "--site-dir", str(tmp_path / "site")],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    assert "WARNING" not in built.stderr
    for page in (tmp_path / "site").glob("*.html"):
        fetched = re.findall(
            r"<(?:script|img|link)[^>]*(?:src|href)=.(https?:)?//", page.read_text("utf-8")
        )
        assert fetched == [], page.name


def test_make_docs_and_continuous_integration_end_at_a_warning() -> None:
    """Strictness counts warnings, which --quiet would drop before they are counted."""
    assert "strict: true" in (ROOT / "mkdocs.yml").read_text("utf-8")
    (recipe,) = re.findall(r"bin/mkdocs build[^)]*", (ROOT / "Makefile").read_text("utf-8"))
    assert recipe == "bin/mkdocs build"
    assert re.search(r"^make docs ", (ROOT / ".ci" / "run").read_text("utf-8"), re.MULTILINE)
