"""``stemwatch db``: version, upgrade, check, backup, restore, copy and prune of the store."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from stemwatch.service.cli import options as o

if TYPE_CHECKING:
    from stemwatch.service.config.plant import Plant
    from stemwatch.service.store.database_url import DatabaseUrl

db_app = typer.Typer(
    name="db",
    no_args_is_help=True,
    rich_markup_mode="rich",
    help="Look after the database: versions, checks, backups, moving, pruning.",
)
WHICH = "Which database"

PlantFile = Annotated[
    Path | None,
    typer.Option("--plant", help="plant.toml, for its database.", rich_help_panel=WHICH),
]
Url = Annotated[
    str,
    typer.Option(
        "--db",
        help="Its URL, instead of --plant; $STEMWATCH_STORAGE_URL goes for both.",
        rich_help_panel=WHICH,
    ),
]


@db_app.callback()
def _db() -> None:
    """Look after the database: versions, checks, backups, moving, pruning."""


@db_app.command()
def version(plant: PlantFile = None, db: Url = "") -> None:
    """Say which schema the database has, and which this program writes. Changes nothing."""
    from stemwatch.service.cli import views
    from stemwatch.service.store.administration.backup import disposing, one_instant
    from stemwatch.service.store.database.engine import existing_engine
    from stemwatch.service.store.migrations.migrate import (
        current_revision,
        is_newer,
        newest_revision,
    )

    address = _address(plant, db)
    with disposing(existing_engine(address)) as engine, one_instant(engine, address) as connection:
        revision = current_revision(connection)
    views.say_result(
        f"{address}: schema {revision or 'none'}; this program writes {newest_revision()}"
    )
    if revision == newest_revision():
        views.say_next("nothing needs to be done; `stemwatch db check` looks it over.")
    elif is_newer(revision):
        views.say_next(
            "a newer stemwatch has written this database: install that version, or take the schema "
            f"back with it, by `stemwatch db downgrade {newest_revision()}`."
        )
    elif revision is None:
        views.say_next(
            "`stemwatch db upgrade`, or the first start of the service, makes the tables."
        )
    else:
        views.say_next("`stemwatch db backup FILE`, then `stemwatch db upgrade`.")


@db_app.command()
def upgrade(plant: PlantFile = None, db: Url = "") -> None:
    """Bring the schema to the newest; whatever opens the database does the same.

    Takes its time on PostgreSQL where many samples have to be moved. Make a backup first.
    """
    from stemwatch.service.cli import views
    from stemwatch.service.store.administration.backup import disposing
    from stemwatch.service.store.database.engine import make_engine
    from stemwatch.service.store.migrations.migrate import newest_revision
    from stemwatch.service.store.migrations.migrate import upgrade as bring_up

    address = _address(plant, db)
    with disposing(make_engine(address)) as engine:
        bring_up(engine, address)
    views.say_result(f"{address}: schema {newest_revision()}")
    views.say_next("`stemwatch db check` looks it over.")


@db_app.command()
def downgrade(
    schema: Annotated[str, typer.Argument(help="Such as 0003; `db version` says the present one.")],
    plant: PlantFile = None,
    db: Url = "",
    yes: Annotated[bool, typer.Option("--yes", help="Do it.")] = False,
) -> None:
    """Take the schema back, for an older program. What only newer schemas hold is LOST."""
    from stemwatch.service.cli import views
    from stemwatch.service.store.administration.backup import disposing
    from stemwatch.service.store.database.engine import existing_engine
    from stemwatch.service.store.migrations.migrate import take_back

    address = _address(plant, db)
    if not yes:
        raise typer.BadParameter(
            "tables and columns that schema does not have would be lost: make a backup with "
            "`stemwatch db backup`, then say --yes",
            param_hint="--yes",
        )
    with disposing(existing_engine(address)) as engine:
        take_back(engine, address, schema)
    views.say_result(f"{address}: schema {schema}")
    views.say_next(
        "start the older program; this one brings the schema up again when it opens the database."
    )


@db_app.command()
def check(plant: PlantFile = None, db: Url = "") -> None:
    """Check the database: schema, integrity, orphans, partitions, numbering, sizes.

    Changes nothing. Exit status 1 where something needs to be done.
    """
    from stemwatch.service.cli import db_views, views
    from stemwatch.service.store.administration.check import check as look

    address = _address(plant, db)
    health = look(address)
    views.out.print(db_views.health_table(str(address), health))
    for note in health.notes:
        views.say_result(note)
    for problem in health.problems:
        views.say_error(problem)
    if health.problems:
        raise typer.Exit(1)
    views.say_result("Nothing is wrong.")
    views.say_next("`stemwatch db backup FILE`, if the last backup is old.")


@db_app.command()
def backup(
    file: Annotated[Path, typer.Argument(help="The file to write, such as stemwatch.zip.")],
    plant: PlantFile = None,
    db: Url = "",
) -> None:
    """Write the whole database to one file, which either engine can be restored from.

    The service may go on: the file holds one instant. It holds names, remarks and the hashes of
    passwords: only its owner may read it.
    """
    from stemwatch.service.cli import db_views, views
    from stemwatch.service.store.administration.backup import backup as carry

    address = _address(plant, db)
    carried = carry(address, file)
    views.out.print(db_views.copied_table(f"{address} in {file}", carried))
    views.say_next(
        f"keep {file} on another computer, and as private as the database. `stemwatch db restore` "
        "fills an empty database from it."
    )


@db_app.command()
def restore(
    file: Annotated[Path, typer.Argument(help="A file that `db backup` wrote.")],
    plant: PlantFile = None,
    db: Url = "",
) -> None:
    """Fill an empty database from a backup, all of it or nothing, and bring its schema up.

    A database that holds anything is left alone: give a new one.
    """
    from stemwatch.service.cli import db_views, views
    from stemwatch.service.store.administration.backup import restore as carry

    address = _address(plant, db)
    carried = carry(o.need_file(file, "FILE"), address)
    views.out.print(db_views.copied_table(f"{file} in {address}", carried))
    views.say_next(
        "give this database as storage.url, or in STEMWATCH_STORAGE_URL, and start the service."
    )


@db_app.command()
def copy(
    to: Annotated[
        str,
        typer.Option(
            "--to",
            envvar="STEMWATCH_COPY_TO",
            show_envvar=True,
            help="URL of the empty database. The variable keeps its password off the screen.",
        ),
    ],
    plant: PlantFile = None,
    db: Url = "",
) -> None:
    """Bring everything into another, empty database, such as from SQLite to PostgreSQL.

    Rows are counted and compared by a digest, and all of them come or none. Stop the service
    first: what it writes meanwhile is not copied. The first database stays as it is.
    """
    from stemwatch.service.cli import db_views, views
    from stemwatch.service.store.administration.backup import copy as carry
    from stemwatch.service.store.database_url import DatabaseUrl

    origin, target = _address(plant, db), DatabaseUrl(to)
    carried = carry(origin, target)
    views.out.print(db_views.copied_table(f"{origin} in {target}", carried))
    views.say_result(f"Now give {target} as storage.url, or in STEMWATCH_STORAGE_URL.")


@db_app.command()
def prune(
    plant: PlantFile = None,
    db: Url = "",
    samples_days: Annotated[
        float | None,
        typer.Option(min=1, help="Keep so many days of samples; with --plant, what it says."),
    ] = None,
    results_days: Annotated[
        float | None,
        typer.Option(min=1, help="Keep so many days of screenings; each valve's latest stays."),
    ] = None,
    alerts_days: Annotated[
        float | None,
        typer.Option(min=1, help="Keep so many days of closed alerts and their messages."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Remove it; without, only count.")] = False,
) -> None:
    """Remove old results, samples and alerts; without --yes, only count them.

    The running service removes old samples by itself. Baselines, notes and maintenance stay.
    """
    from stemwatch.service.cli import db_views, views
    from stemwatch.service.store.administration import prune as pruning
    from stemwatch.service.store.store import open_existing_store

    address = _address(plant, db)
    if samples_days is None and plant is not None:
        # Whole days are removed: less than one is as much as one.
        samples_days = max(1.0, _plant(plant).service.keep_samples_days)
    try:
        ages = pruning.RetentionDays(
            samples_days=samples_days, results_days=results_days, alerts_days=alerts_days
        )
    except ValueError as error:
        raise typer.BadParameter(str(error)) from None
    if ages == pruning.RetentionDays():
        raise typer.BadParameter("give --samples-days, --results-days or --alerts-days")
    with open_existing_store(address) as store:
        went = pruning.prune(store, ages) if yes else pruning.would_prune(store, ages)
    views.out.print(db_views.pruned_table(str(address), went, done=yes))
    if not yes and went.total:
        views.say_result("Nothing was removed; --yes does it. Make a backup first.")
    else:
        views.say_next("`stemwatch db check` says how large it is now.")


def _address(plant: Path | None, db: str) -> DatabaseUrl:
    import os

    from stemwatch.service.store.database_url import DatabaseUrl

    if db:
        return DatabaseUrl(db)
    if plant is not None:
        return _plant(plant).storage
    if url := os.environ.get("STEMWATCH_STORAGE_URL"):
        return DatabaseUrl(url)
    raise typer.BadParameter("give --plant plant.toml or --db URL, or set STEMWATCH_STORAGE_URL")


def _plant(path: Path) -> Plant:
    from stemwatch.service.config import load_plant

    return load_plant(o.need_file(path, "--plant"))
