"""The docs as a site (``make docs``): the README first, pages in the order of its list, and links
that leave ``docs/`` in the repository led to copies beside the pages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
# What pages of docs/ link beside them, by its place in the repository, and its name on the site.
BESIDE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "CONTRIBUTING.md",
    "CHANGELOG.md": "CHANGELOG.md",
    "LICENSE": "LICENSE.txt",
    "deploy/README.md": "deploy.md",
    "service/report/contract.schema.json": "contract.schema.json",
    "service/explain/explain.schema.json": "explain.schema.json",
    "deploy/prometheus/stemwatch.rules.yml": "stemwatch.rules.yml",
}
LINK = re.compile(r"\[(?P<words>[^\]\n]*)\]\((?P<target>[^)\s#:]+)(?P<heading>#[^)\s]*)?\)")
LISTED = re.compile(r"\]\(docs/([a-z-]+\.md)\)")


def on_config(config: Any) -> Any:
    """The order of the pages; each has its heading as its name."""
    config.nav = ["index.md", *listed(), "deploy.md", "CONTRIBUTING.md", "CHANGELOG.md"]
    config.mdx_configs["toc"] = {"slugify": _anchor, "permalink": False}
    return config


def listed() -> list[str]:
    """The pages of docs/ as the README's section "Read on" lists them."""
    readme = (ROOT / "README.md").read_text("utf-8")
    return LISTED.findall(readme.split("\n## Read on\n")[1])


def on_files(files: Any, *, config: Any) -> Any:
    """Copies of what is linked beside the pages."""
    from mkdocs.structure.files import File  # in an environment of its own: make docs

    for place, name in BESIDE.items():
        text = (ROOT / place).read_text("utf-8")
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, *, page: Any, **_: Any) -> str:
    """Links as they are on the site."""
    name = page.file.src_uri
    source = next((place for place, copy in BESIDE.items() if copy == name), f"docs/{name}")
    return LINK.sub(lambda link: _on_site(link, (ROOT / source).parent), markdown)


def _on_site(link: re.Match[str], folder: Path) -> str:
    """A link to a page or to what is copied beside; the bare words where it leads to a file of the
    repository that is not on the site. What leads nowhere stays, and ends the build."""
    words, target, heading = link["words"], link["target"], link["heading"] or ""
    file = (folder / target).resolve()
    if not file.is_relative_to(ROOT) or not file.exists():
        return link[0]
    place = file.relative_to(ROOT).as_posix()
    if place in BESIDE:
        return f"[{words}]({BESIDE[place]}{heading})"
    if place.startswith("docs/"):
        return f"[{words}]({place.removeprefix('docs/')}{heading})"
    return words


def _anchor(heading: str, separator: str) -> str:
    """The anchor that readers of the repository make of a heading."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", separator)
