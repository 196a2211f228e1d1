"""`gcs repair`: a data folder whose catalogue is damaged or gone."""

import argparse
from pathlib import Path

NAME = "repair"
HELP = "make the catalogue of a data folder whole, from its backup and the recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("data", metavar="DATA", type=Path, help="the folder that gcs serve was given as --data")


def run(args: argparse.Namespace) -> int:
    """Repair, and say what was done."""
    from gcs.catalogue.rebuild import rebuild
    from gcs.catalogue.sole_user import sole_user
    from gcs.errors import CatalogueError
    from gcs.settings import Settings

    settings = Settings(data=args.data)
    if not settings.flights.is_dir() and not settings.database.exists():
        raise CatalogueError(
            f"{args.data} is no data folder of gcs serve: there is neither catalogue nor flights in it"
        )
    with sole_user(args.data):
        for line in rebuild(settings):
            print(line)
    return 0
