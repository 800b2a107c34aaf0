"""What ``deploy/`` hands to a plant: it parses, it holds together, and it agrees with the program.

No container engine takes part; what that leaves untested stands in ``deploy/README.md``.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from stemwatch.service.cli import app
from stemwatch.service.config import load_plant

DEPLOY = Path(__file__).parents[2] / "deploy"
SERVICES = {"stemwatch", "plant", "postgres", "reader", "grafana"}


@pytest.fixture(scope="module")
def compose() -> dict:
    """The compose file as data."""
    return yaml.safe_load((DEPLOY / "compose" / "compose.yaml").read_text("utf-8"))


def test_the_compose_file_starts_everything_that_is_promised(compose: dict) -> None:
    """Service, simulated plant, PostgreSQL, Grafana and its reader, and nothing open to the net."""
    assert set(compose["services"]) == SERVICES
    ports = [port for service in compose["services"].values() for port in service.get("ports", [])]
    assert len(ports) == 2
    assert all(port.startswith("127.0.0.1:") for port in ports)


@pytest.mark.parametrize("name", ["stemwatch", "plant"])
def test_our_containers_are_closed(compose: dict, name: str) -> None:
    """A read-only root, no rights, and no way to more."""
    service = compose["services"][name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]


@pytest.mark.parametrize("name", ["stemwatch", "plant"])
def test_the_commands_of_the_containers_exist(compose: dict, name: str) -> None:
    """Each command and option that the compose file gives is one that the program takes."""
    command, *options = compose["services"][name]["command"]
    output = CliRunner().invoke(app, [command, "--help"], env={"COLUMNS": "200"}).output
    named = {option.partition("=")[0] for option in options}
    assert named
    assert {option for option in named if option not in output} == set()


def test_every_file_that_is_mounted_is_there(compose: dict) -> None:
    """A mount of a missing file would make an empty folder in its place."""
    mounted = [
        volume.partition(":")[0]
        for service in compose["services"].values()
        for volume in service.get("volumes", [])
        if volume.startswith(".")
    ]
    assert len(mounted) >= 6
    assert [name for name in mounted if not (DEPLOY / "compose" / name).exists()] == []


def test_no_password_stands_in_the_compose_file(compose: dict) -> None:
    """Passwords come from the environment, and a missing one stops the start."""
    named = [
        value
        for service in compose["services"].values()
        for key, value in service.get("environment", {}).items()
        if "PASSWORD" in key
    ]
    assert len(named) >= 5
    assert [value for value in named if ":?" not in value] == []


def test_a_password_of_any_letters_may_be_chosen(compose: dict) -> None:
    """It stands in no URL, in which @, / and # would end it."""
    stemwatch = compose["services"]["stemwatch"]["environment"]
    assert stemwatch["STEMWATCH_STORAGE_URL"] == "postgresql://stemwatch@postgres/stemwatch"
    password = compose["services"]["postgres"]["environment"]["POSTGRES_PASSWORD"]
    assert stemwatch["PGPASSWORD"] == password


def test_the_simulated_plant_can_be_left_out(compose: dict) -> None:
    """As the page says: nothing waits for it, so the file is whole without it."""
    waiting = {name: set(one.get("depends_on", {})) for name, one in compose["services"].items()}
    assert [name for name, others in waiting.items() if "plant" in others] == []


@pytest.mark.parametrize(
    ("proxy", "takes_away"),
    [
        ("nginx.conf", 'proxy_set_header X-Remote-User "";'),
        ("Caddyfile", "header_up -X-Remote-User"),
    ],
)
def test_a_proxy_takes_a_forged_name_away(proxy: str, takes_away: str) -> None:
    """Whoever sets ``user_header`` believes that header of the proxy: from outside nobody may be
    let through who writes it himself."""
    lines = [line.strip() for line in (DEPLOY / "proxy" / proxy).read_text("utf-8").splitlines()]
    assert takes_away in lines


def test_the_plant_of_the_compose_file_is_the_one_that_is_simulated(tmp_path: Path) -> None:
    """Its registers and valves are those that ``simulate --modbus`` serves."""
    from stemwatch.models.studies.simulator import demo_plant
    from stemwatch.service.modbus_plant.plant_file import plant_toml

    simulated = tmp_path / "plant.toml"
    simulated.write_text(plant_toml(demo_plant(1), host="plant", port=5020), encoding="utf-8")
    ours, theirs = load_plant(DEPLOY / "compose" / "plant.toml"), load_plant(simulated)
    assert ours.problems == ()
    assert ours.devices == theirs.devices
    assert ours.valves == theirs.valves
    assert len(ours.valves) == 15


def test_the_example_plant_file_is_read_without_a_complaint() -> None:
    """What a plant copies and changes is right before it is changed."""
    assert load_plant(DEPLOY / "plant.example.toml").problems == ()


def test_the_image_runs_what_the_compose_file_runs(compose: dict) -> None:
    """A user by number, a health check of an open page, and the steps of install.sh."""
    lines = (DEPLOY / "Dockerfile").read_text("utf-8").replace("\\\n", " ").splitlines()
    assert [line for line in lines if re.match(r"USER \d+:\d+$", line)]
    assert any("/health'" in line for line in lines if "CMD" in line)
    (install,) = [line for line in lines if "install.sh" in line and line.startswith("RUN")]
    assert shlex.split(install)[-2:] == ["/opt/stemwatch", "postgres"]
    assert compose["services"]["stemwatch"]["build"]["dockerfile"] == "deploy/Dockerfile"


def test_what_the_image_is_built_from_is_let_through() -> None:
    """``.dockerignore`` lets through every file that setup and installation read."""
    listing = (DEPLOY.parent / ".dockerignore").read_text("utf-8").splitlines()
    needed = {"pyproject.toml", "setup.py", "constraints.txt", "README.md", "LICENSE"}
    needed |= {"stemwatch", "service", "connectors", "models", "deploy/install.sh"}
    assert {f"!{name}" for name in needed} <= set(listing)
    assert "*" in listing


@pytest.mark.parametrize("script", ["install.sh", "wheelhouse.sh"])
def test_a_script_without_a_folder_says_how_it_is_called(script: str) -> None:
    """Both scripts are plain sh, and teach."""
    process = subprocess.run(
        ["sh", str(DEPLOY / script)], capture_output=True, text=True, check=False
    )
    assert process.returncode != 0
    assert f"deploy/{script}" in process.stderr


def test_the_unit_is_one_that_systemd_accepts(tmp_path: Path) -> None:
    """``systemd-analyze verify`` has nothing to say; the program's path is one that exists here."""
    analyze = shutil.which("systemd-analyze")
    if analyze is None:
        pytest.skip("systemd-analyze is not installed: the unit was not verified")
    text = (DEPLOY / "systemd" / "stemwatch.service").read_text("utf-8")
    here = text.replace("/opt/stemwatch/bin/stemwatch", sys.executable)
    assert here != text
    unit = tmp_path / "stemwatch.service"
    unit.write_text(here, encoding="utf-8")
    process = subprocess.run(
        [analyze, "verify", str(unit)], capture_output=True, text=True, check=False
    )
    assert (process.returncode, process.stderr.strip()) == (0, "")


def test_descriptors_and_memory_are_bounded_wherever_it_runs(compose: dict) -> None:
    """The unit and the container say how many files and how much memory the service may have."""
    unit = (DEPLOY / "systemd" / "stemwatch.service").read_text("utf-8").splitlines()
    assert "LimitNOFILE=8192" in unit
    assert "MemoryMax=80%" in unit
    assert compose["services"]["stemwatch"]["ulimits"] == {"nofile": 8192}
    assert compose["services"]["stemwatch"]["mem_limit"]
