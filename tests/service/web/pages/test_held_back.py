"""What chance alone may have named is said on the valve's page, in a sentence."""

from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import httpx
import pytest

from stemwatch.models.mismatch.findings import Finding
from stemwatch.service.run.finish import hold_back
from stemwatch.service.store.store import Store
from tests.service.example_mismatches import named
from tests.service.web.example_plant import HEALTHY, NOW, STICKY, WATCH, screening

SAID = "chance alone may have named this"


@pytest.mark.parametrize(("p_value", "held_back"), [(0.04, True), (0.001, False)])
def test_a_finding_that_does_not_stand_says_so(
    filled: Store, client: httpx.Client, p_value: float, held_back: bool
) -> None:
    """Beside what was found, so that nobody plans work on it alone."""
    run = filled.begin_run(software_version="1")
    for valve in (HEALTHY, WATCH, STICKY):
        changed = replace(named(), finding=Finding.NAMED, p_value=p_value, runs=None)
        if valve != STICKY:
            changed = replace(changed, finding=Finding.NONE, effects=(), p_value=None)
        filled.save(screening(valve, at=NOW + timedelta(hours=1), mismatch=changed), run)
    hold_back(filled, run)
    page = client.get("/valve", params={"id": STICKY})
    assert page.status_code == 200
    assert (SAID in page.text) is held_back
    assert SAID not in client.get("/valve", params={"id": HEALTHY}).text
    ranking = {valve["valve"]: valve for valve in client.get("/api/v1/valves").json()["valves"]}
    assert (ranking[STICKY]["left_out"] != [], ranking[STICKY]["held_back"]) == (True, held_back)
    assert ranking[HEALTHY]["held_back"] is False
    assert ("(held back)" in client.get("/").text) is held_back


def test_the_page_says_what_windows_of_weeks_confirm(filled: Store, client: httpx.Client) -> None:
    """Once two days name it: since when and in how many windows, with the picture."""
    for day in range(1, 4):
        run = filled.begin_run(software_version="1")
        changed = replace(named(), p_value=0.001, runs=None)
        if day == 2:
            changed = replace(changed, finding=Finding.NONE, effects=(), p_value=None)
        filled.save(screening(STICKY, at=NOW + timedelta(days=day), mismatch=changed), run)
    page = client.get("/valve", params={"id": STICKY}).text
    assert "Over the windows of the last weeks" in page
    assert "Asymmetric rate limit: first seen on" in page
    assert 'class="by-window"' in page
    assert "Over the windows of" not in client.get("/valve", params={"id": HEALTHY}).text
