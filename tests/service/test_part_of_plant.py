"""Sites, areas and units: one planner sees his unit, and a unit that is not there is told."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from stemwatch.connectors.historian import ReadOptions
from stemwatch.service.cli.reading import request_of
from stemwatch.service.config import load_plant
from stemwatch.service.plant_path import PartOfPlant, PlantPath, UnknownPart
from stemwatch.service.run.plan import Request, make_plan
from stemwatch.service.store.runs.schedule import ScreeningSchedule
from stemwatch.service.store.screenings.ranking import RankingFilter
from stemwatch.service.store.store import Store, open_store
from stemwatch.service.web.site import Site
from tests.service.web import example_plant
from tests.service.web.example_plant import BLIND, NOW, STICKY, WATCH
from tests.service.web.signed_in import cookie_of

PLANT = [
    PlantPath(site="Harbour", area="Crude", unit="100", loop="FC-1"),
    PlantPath(site="Harbour", area="Crude", unit="200", loop="FC-2"),
    PlantPath(site="Harbour", area="Reforming", unit="200"),
    PlantPath(site="Inland"),
]


@pytest.fixture
def store(tmp_path: Path) -> Iterator[Store]:
    """An empty store."""
    with open_store(f"sqlite:///{tmp_path / 'units.db'}") as opened:
        yield opened


def in_units(plant: Path) -> Path:
    """The small plant's file with a unit for its healthy and its sticking valve."""
    text_of_file = re.sub(r'unit = "\d+"\n', "", plant.read_text("utf-8"))
    first, second, *rest = text_of_file.split("[[valves]]\n")[1:]
    tables = [f'unit = "100"\n{first}', f'unit = "200"\n{second}', *rest]
    plant.write_text("[[valves]]\n".join([text_of_file.split("[[valves]]\n")[0], *tables]), "utf-8")
    return plant


def test_a_path_is_what_is_known_of_it() -> None:
    """From the largest level to the smallest, without those that nobody has said."""
    assert [valve.path for valve in PLANT] == [
        "Harbour/Crude/100/FC-1",
        "Harbour/Crude/200/FC-2",
        "Harbour/Reforming/200",
        "Inland",
    ]
    assert [valve.area_and_unit for valve in PLANT[1:]] == [
        "Crude, unit 200",
        "Reforming, unit 200",
        "",
    ]


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (PartOfPlant(), [0, 1, 2, 3]),
        (PartOfPlant(units=("200",)), [1, 2]),
        (PartOfPlant(areas=("Crude",), units=("200",)), [1]),
        (PartOfPlant(sites=("Inland", "Harbour"), units=("100", "200")), [0, 1, 2]),
    ],
)
def test_levels_narrow_each_other_and_names_of_one_level_add_up(
    part: PartOfPlant, expected: list[int]
) -> None:
    """Unit 200 of one area is not that of another."""
    assert part.valves(PLANT) == [PLANT[index] for index in expected]


@pytest.mark.parametrize(
    ("part", "said"),
    [
        (PartOfPlant(units=("100", "300")), "there is no unit '300'; there are 100, 200"),
        (PartOfPlant(sites=("Moon",)), "there is no site 'Moon'; there are Harbour, Inland"),
        (
            PartOfPlant(areas=("Reforming",), units=("100",)),
            "no valve is in area 'Reforming' and unit '100'",
        ),
    ],
)
def test_what_is_not_there_is_told_with_what_there_is(part: PartOfPlant, said: str) -> None:
    """So that a typing error is seen at once."""
    with pytest.raises(UnknownPart, match=f"^{said}$"):
        part.valves(PLANT)
    with pytest.raises(UnknownPart, match=r"the plant file names no unit of any valve"):
        PartOfPlant(units=("1",)).valves(PLANT[3:])


def test_a_request_for_a_unit_reads_its_valves_only(plant: Path) -> None:
    """From the plant's own sources, and from a file on the command line."""
    loaded = load_plant(in_units(plant), environment={})
    (of_unit,) = PartOfPlant(units=("200",)).valves(loaded.valves.values())
    export = str(next(iter(loaded.source_files("historian"))))
    for sources in ((), (export,)):
        plan = make_plan(Request(plant=loaded, valves=(of_unit.id,), sources=sources))
        assert [task.tags.valve for task in plan.tasks] == [of_unit.id]


def test_a_valve_of_the_plant_is_screened_alone(plant: Path) -> None:
    """By its name on the command line, beside the plant file."""
    wanted = list(load_plant(plant, environment={}).valves)[1]
    request = request_of(None, plant, {}, wanted, "", "", ReadOptions())
    assert [task.tags.valve for task in make_plan(request).tasks] == [wanted]


@pytest.mark.parametrize("command", ["screen", "run-now"])
def test_an_unknown_unit_is_wrong_usage_that_lists_the_units(
    stemwatch, plant: Path, tmp_path: Path, command: str
) -> None:
    """Before anything is read."""
    outcome = stemwatch(command, "--plant", str(in_units(plant)), "--unit", "300")
    assert outcome.status == 2
    said = " ".join(outcome.said.replace("│", " ").split())
    assert "there is no unit '300'; there are 100, 200" in said
    assert not list(tmp_path.glob("*.db"))


def test_a_schedule_screens_the_valves_of_its_units() -> None:
    """Beside those of its areas and those that it names; without any of them all."""
    valves = [example_plant.VALVES[0], example_plant.VALVES[1], example_plant.VALVES[2]]
    taken = [
        [valve.id for valve in valves if schedule.takes(valve)]
        for schedule in (
            ScreeningSchedule(name="a", units=("120",)),
            ScreeningSchedule(name="b", units=("120",), areas=("Area 200",)),
            ScreeningSchedule(name="c"),
        )
    ]
    assert taken == [[WATCH], [WATCH, "PIC-201"], [STICKY, WATCH, "PIC-201"]]


def test_pages_and_api_show_a_unit(store: Store) -> None:
    """The ranking, the open alerts and the API; what is not there is told with what there is."""
    example_plant.fill(store, months=1)
    assert store.levels()["unit"] == ("110", "120")
    ranked = store.ranking(RankingFilter(units=("120",)))
    assert [line.valve for line in ranked.lines] == [WATCH]
    assert store.ranking(RankingFilter(text="120")).lines[0].path == "Area 100/120"
    of_unit = store.alerts.in_state("open", NOW, part=PartOfPlant(units=("110",)))
    assert [alert.valve for alert in of_unit] == [STICKY]
    site = Site(store=store, clock=lambda: NOW)
    with (
        example_plant.serving(site) as base,
        httpx.Client(
            base_url=base, trust_env=False, verify=False, timeout=30.0, cookies=cookie_of(site)
        ) as client,
    ):
        page = client.get("/", params={"unit": "120"}).text
        unknown = client.get("/", params={"unit": "130"}).text
        lines = client.get("/api/v1/valves", params={"unit": "110"}).json()["valves"]
        refused = client.get("/api/v1/valves", params={"unit": "130"})
        alerts = client.get("/api/v1/alerts", params={"unit": "120"}).json()
        alerts_page = client.get("/alerts", params={"unit": "110"}).text
    assert WATCH in page
    assert f">{STICKY}<" not in page
    assert "NE 107: maintenance required" in page
    assert "There is no unit &#39;130&#39;; there are 110, 120." in unknown
    assert [(line["valve"], line["unit"]) for line in lines] == [(STICKY, "110")]
    assert refused.status_code == 422
    assert "there is no unit '130'; there are 110, 120" in refused.text
    assert alerts == []
    assert f"{STICKY} sticks" in alerts_page


def test_a_valve_without_a_place_is_in_no_part(store: Store) -> None:
    """A unit never takes what the plant file says nothing of."""
    store.save_valves([replace(example_plant.VALVES[0], unit="110")])
    assert store.valves_in(PartOfPlant(units=("110",))) == [STICKY]
    assert BLIND not in store.valves_in(PartOfPlant(units=("110",)))
