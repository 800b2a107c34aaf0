"""The documentation against the code: nothing undescribed, nothing described that is not there."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any, get_args

import click
import pytest
import typer
from pydantic import BaseModel

from stemwatch.connectors.historian.connector import TextExportSettings
from stemwatch.connectors.historian.options import ReadOptions
from stemwatch.models.mismatch.terms import catalogue
from stemwatch.models.narx.example import NarxSettings
from stemwatch.models.screening.screen import Case, Options, screen
from stemwatch.models.studies.simulator import draw_sticky, simulate_loop
from stemwatch.models.verdict import Shape, Verdict
from stemwatch.service.cli import app
from stemwatch.service.config.load import LimitsTable, TopTable
from stemwatch.service.config.schema import Tag, Valve
from stemwatch.service.config.service_schema import (
    AlertRules,
    NotifierTable,
    ScheduleTable,
    ServiceSection,
)
from stemwatch.service.config.valve_list import COLUMNS

REPOSITORY = Path(__file__).parent.parent
DOCS = REPOSITORY / "docs"
PAGES = [
    *(REPOSITORY / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")),
    *sorted(DOCS.glob("*.md")),
]
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
COMMAND_LINE = re.compile(r"^(?:\$ |> )?stemwatch ([a-z-]+)(.*)$", re.MULTILINE)
TABLES = (
    TopTable,
    LimitsTable,
    TextExportSettings,
    Valve,
    Tag,
    AlertRules,
    NotifierTable,
    ScheduleTable,
    ServiceSection,
)
SCHEMA = REPOSITORY / "service/report/contract.schema.json"


def _commands() -> dict[str, click.Command]:
    group = typer.main.get_command(app)
    assert hasattr(group, "commands")
    commands: dict[str, click.Command] = {}
    for name, command in group.commands.items():
        inner = getattr(command, "commands", None)  # a group, such as modbus
        commands |= (
            {f"{name} {verb}": item for verb, item in inner.items()} if inner else {name: command}
        )
    return commands


def _options(command: click.Command) -> set[str]:
    return {name for option in command.params for name in (*option.opts, *option.secondary_opts)}


@pytest.mark.parametrize("name", sorted(_commands()))
def test_every_command_is_described(name: str) -> None:
    """Each command has a section of its own in docs/commands.md."""
    assert f"## stemwatch {name}\n" in _page("commands.md")


@pytest.mark.parametrize("name", sorted(_commands()))
def test_every_option_is_described_with_its_command(name: str) -> None:
    """Each option stands in the section of its command, or among those that read files."""
    page = _page("commands.md")
    own = page.split(f"## stemwatch {name}\n")[1].split("\n## ")[0]
    shared = page.split("## Options that say how a file is read\n")[1].split("\n## ")[0]
    options = {o for o in _options(_commands()[name]) if o.startswith("--")} - {"--help"}
    described = set(re.findall(r"`(--[a-z-]+)", own + shared))
    assert options - described == set()


@pytest.mark.parametrize("name", sorted(_commands()))
def test_every_default_that_is_stated_is_the_one_in_the_code(name: str) -> None:
    """``default 40`` in the row of an option; one that the command finds by itself is left out."""
    page = _page("commands.md")
    own = page.split(f"## stemwatch {name}\n")[1].split("\n## ")[0]
    defaults = {option: p.default for p in _commands()[name].params for option in p.opts}
    rows = r"^\| `(--[a-z-]+)` \|.*default ([\d.]+|`[^`]+`)(?=[ ,;.|])"
    for option, stated in re.findall(rows, own, re.MULTILINE):
        default = defaults[option]
        if default not in (None, ""):
            expected = f"{default:g}" if isinstance(default, (int, float)) else str(default)
            assert stated.strip("`") == expected, f"{name} {option}"


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_every_command_line_that_is_shown_would_be_understood(page: Path) -> None:
    """A command shown in a code block exists and has the options it is shown with."""
    commands = _commands()
    for block in _code_blocks(page):
        for name, rest in COMMAND_LINE.findall(block):
            if name not in commands:  # the first word after a group's name is its verb
                verb, _, rest = rest.strip().partition(" ")
                name = f"{name} {verb}"
            assert name in commands, f"{page.name}: stemwatch {name}"
            distinct = set(re.findall(r"(?<!\S)--[a-z-]+", rest))
            assert distinct - _options(commands[name]) - {"--help"} == set(), f"{page.name}: {rest}"


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_every_make_target_that_is_shown_exists(page: Path) -> None:
    """``make something`` in the documentation is a target of the Makefile."""
    makefile = (REPOSITORY / "Makefile").read_text("utf-8")
    targets = set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    text = " ".join([*_code_blocks(page), *re.findall(r"`([^`\n]+)`", page.read_text("utf-8"))])
    assert set(re.findall(r"(?:^|\s)make ([a-z][a-z-]*)\b(?!=)", text)) - targets == set()


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_every_relative_link_leads_somewhere(page: Path) -> None:
    """A link to a file finds it, and one to a heading finds the heading."""
    for link in LINK.findall(page.read_text("utf-8")):
        if link.startswith(("http://", "https://")):
            continue
        name, _, heading = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{page.name}: {link}"
        assert not heading or heading in _anchors(target), f"{page.name}: {link}"


def test_every_page_is_reached_from_the_readme() -> None:
    """No page of docs/ is an orphan."""
    linked = set(LINK.findall((REPOSITORY / "README.md").read_text("utf-8")))
    assert {f"docs/{page.name}" for page in DOCS.glob("*.md")} - linked == set()


@pytest.mark.parametrize("title", ["The walk of one sample", "Where does it come from?"])
def test_every_place_that_the_architecture_names_is_there(title: str) -> None:
    """Files and functions in the tables: a reader looks them up."""
    section = _page("architecture.md").split(f"## {title}\n")[1].split("\n## ")[0]
    rows = [row.split("|")[2] for row in section.splitlines() if row.startswith("| ")][1:]
    assert len(rows) > 12
    for row in rows:
        folder, text = REPOSITORY, ""
        for name in re.findall(r"`([^`]+)`", row):
            if "." in name or "/" in name:
                inside = folder / name
                path = REPOSITORY / name if "/" in name else inside
                assert path.exists(), f"architecture.md names {name}"
                folder = path.parent
                text = path.read_text("utf-8") if path.is_file() else ""
            elif not name.startswith("["):
                assert re.search(rf"(def|class) {name}\b", text), f"{name} is not in {row}"


@pytest.mark.parametrize(
    "model", [TopTable, LimitsTable, TextExportSettings, Valve, Tag], ids=lambda m: m.__name__
)
def test_every_key_of_the_plant_file_is_described(model: type[BaseModel]) -> None:
    """Each key that plant.toml takes stands in docs/plant-file.md."""
    page = _page("plant-file.md")
    keys = set(_keys(model))
    assert {key for key in keys if not re.search(rf"[`.\[]{key}[`\]]", page)} == set()


def test_every_column_of_a_valve_list_is_described() -> None:
    """Each heading that a valve list may have stands in docs/plant-file.md."""
    page = _page("plant-file.md")
    assert [column for column in COLUMNS if f"`{column}`" not in page] == []


def test_the_defaults_of_the_limits_are_the_documented_ones() -> None:
    """A default in the table of limits is the one in the code."""
    page = _page("plant-file.md")
    stated = dict(re.findall(r"\| `(\w+)` \| ([\d.]+) \|", page))
    defaults = {name: field.default for name, field in LimitsTable.model_fields.items()}
    assert {name: float(value) for name, value in stated.items()} == defaults


@pytest.mark.parametrize("option", [option.name for option in fields(ReadOptions)])
def test_every_reading_option_is_described(option: str) -> None:
    """Each way to settle an ambiguity of a file stands in docs/historian-formats.md."""
    assert f"`{option}`" in _page("historian-formats.md")


def test_every_indicator_that_the_code_can_make_is_described() -> None:
    """Each name handed to an indicator in the code stands in docs/indicators.md."""
    page = _page("indicators.md")
    patterns = _indicator_patterns()
    assert len(patterns) > 20
    assert [p for p in patterns if not re.search(f"`{p}`", page)] == []


def test_every_indicator_of_a_screening_is_described() -> None:
    """What a screening of a sticking valve, compared with a baseline, yields is documented."""
    loop = draw_sticky(1, 5)[0]
    recording = simulate_loop(loop, 5).recording
    options = Options(narx_settings=NarxSettings(seeds=1))
    (first,) = screen([Case(recording=recording)], options)
    again = replace(options, mismatch=False)  # physics that S and J leave out are in the first
    (second,) = screen([Case(recording=recording, baseline=first.network)], again)
    documented = set(re.findall(r"^\| `(\w+)`", _page("indicators.md"), re.MULTILINE))
    assert "baseline_ratio" in second.indicators
    assert (set(first.indicators) | set(second.indicators)) - documented == set()


@pytest.mark.parametrize("word", [*Verdict, *Shape], ids=lambda word: word.value)
@pytest.mark.parametrize("page", ["method.md", "json.md"])
def test_every_verdict_and_shape_is_explained(word: Verdict | Shape, page: str) -> None:
    """A word that a report may hold stands in the method and in the contract."""
    assert word.value in _page(page)


def test_every_effect_that_can_be_named_is_described() -> None:
    """The catalogue of docs/explain.md has each term and no other, in the words of pages."""
    section = _page("explain.md").split("## The catalogue\n")[1].split("\n## ")[0]
    described = dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", section, re.MULTILINE))
    assert described == {slug: term.words.plain for slug, term in catalogue().items()}
    readme = (REPOSITORY / "README.md").read_text("utf-8")
    assert f"[{len(described)} effects](docs/explain.md#the-catalogue)" in readme


def test_every_verdict_is_explained_in_the_readme() -> None:
    """The words are explained where a new reader begins."""
    readme = (REPOSITORY / "README.md").read_text("utf-8")
    assert [word.value for word in Verdict if f"**{word.value}**" not in readme] == []


def test_every_field_of_the_json_contract_is_described() -> None:
    """Each property of the schema stands in docs/json.md."""
    page = _page("json.md")
    names = set(_properties(json.loads(SCHEMA.read_text("utf-8"))))
    assert len(names) > 25
    assert {name for name in names if f"`{name}`" not in page} == set()


def test_the_page_of_the_contract_names_its_version() -> None:
    """The version in the heading of docs/json.md is the schema's."""
    schema = json.loads(SCHEMA.read_text("utf-8"))
    number = schema["$defs"]["screening"]["properties"]["version"]["const"]
    assert _page("json.md").startswith(f"# The JSON contract, version {number}\n")


def _keys(model: type[BaseModel]) -> Iterator[str]:
    """The keys of a table and of the tables in it."""
    for name, field in model.model_fields.items():
        yield name
        for inner in (field.annotation, *get_args(field.annotation)):
            if isinstance(inner, type) and issubclass(inner, BaseModel):
                yield from _keys(inner)


def _properties(schema: Any) -> Iterator[str]:
    """Every property name in a schema, at any depth."""
    if isinstance(schema, dict):
        properties = schema.get("properties", {})
        yield from properties
        for inner in schema.values():
            yield from _properties(inner)
    elif isinstance(schema, list):
        for inner in schema:
            yield from _properties(inner)


def _indicator_patterns() -> list[str]:
    """Names given to ``_single_indicator``, ``_estimated``; what is filled in matches anything."""
    tree = ast.parse((REPOSITORY / "models/health_indicators/indicators.py").read_text("utf-8"))
    calls = (node for node in ast.walk(tree) if isinstance(node, ast.Call) and node.args)
    named = (c.args[0] for c in calls if ast.unparse(c.func) in ("_single_indicator", "_estimated"))
    patterns = []
    for name in named:
        if isinstance(name, ast.Constant):
            patterns.append(str(name.value))
        elif isinstance(name, ast.JoinedStr):
            parts = (str(v.value) if isinstance(v, ast.Constant) else r"\w+" for v in name.values)
            patterns.append("".join(parts))
    return patterns


@cache
def _page(name: str) -> str:
    return (DOCS / name).read_text("utf-8")


def _code_blocks(page: Path) -> list[str]:
    return re.findall(r"^```\w*\n(.*?)^```", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def _anchors(page: Path) -> set[str]:
    """The anchors that a reader makes of a page's headings."""
    headings = re.findall(r"^#+ (.+)$", page.read_text("utf-8"), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings)
    return {heading.strip().replace(" ", "-") for heading in plain}
