"""`gcs token`: who may do what on a station."""

import argparse
from pathlib import Path

NAME = "token"
HELP = "make, list or revoke tokens of a station, each with a name and a role, and links to single flights"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    doing = parser.add_subparsers(dest="doing", required=True, metavar="add|list|revoke|links|revoke-link")
    add = doing.add_parser("add", help="make a token; it is printed once, and kept nowhere")
    add.add_argument("name", metavar="NAME", help="whose it is")
    add.add_argument(
        "--role", default="viewer", choices=("viewer", "operator", "admin"),
        help="viewer (default): look; operator: also uploads, jobs, deletes; admin: also aircraft, users, the log",
    )  # fmt: skip
    add.add_argument("--days", type=float, metavar="N", help="how long it holds; without it until it is revoked")
    listed = doing.add_parser("list", help="names, roles and ends of all tokens")
    listed.add_argument("--json", action="store_true")
    revoke = doing.add_parser("revoke", help="take a token back; it ends with the service's next request")
    revoke.add_argument("name", metavar="NAME")
    links = doing.add_parser("links", help="links to single flights: ids, flights, makers and ends")
    links.add_argument("--json", action="store_true")
    revoke_link = doing.add_parser("revoke-link", help="end a link with the service's next request")
    revoke_link.add_argument("id", metavar="ID")
    for one in (add, listed, revoke, links, revoke_link):
        one.add_argument(
            "--data", metavar="DIR", type=Path, default=Path("data"), help="the station's folder (default data)"
        )


def run(args: argparse.Namespace) -> int:
    """Do what was asked."""
    from gcs.access.shares import Shares
    from gcs.access.token_file import TokenFile, without_hash
    from gcs.settings import Settings
    from gcs.text.jsontext import dumps

    settings = Settings(data=args.data)
    file, shares = TokenFile(settings.tokens), Shares(settings.shares)
    if args.doing == "links" and args.json:
        print(dumps([one.shown() for one in shares.known()], indent=2))
    elif args.doing == "links":
        for link in shares.known():
            print(f"{link.id}  {link.flight}  by {link.maker}  until {_minute(link.expires)}")
    elif args.doing == "revoke-link":
        shares.revoke(args.id)
    elif args.doing == "add":
        print(file.add(args.name, args.role, args.days))
    elif args.doing == "revoke":
        file.revoke(args.name)
    elif args.json:
        print(dumps([without_hash(one) for one in file.tokens()], indent=2))
    else:
        for one in file.tokens():
            end = "" if one.expires is None else f"  until {_minute(one.expires)}"
            print(f"{one.name}  {one.role}{end}")
    return 0


def _minute(utc_s: float) -> str:
    from gcs.text.utctext import utc_text

    return f"{utc_text(round(utc_s * 1e9))[:16]}Z"
