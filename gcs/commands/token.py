"""`gcs token`: who may do what on a station."""

import argparse
from pathlib import Path

NAME = "token"
HELP = "make, list or revoke tokens of a station, each with a name and a role"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    doing = parser.add_subparsers(dest="doing", required=True, metavar="add|list|revoke")
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
    for one in (add, listed, revoke):
        one.add_argument(
            "--data", metavar="DIR", type=Path, default=Path("data"), help="the station's folder (default data)"
        )


def run(args: argparse.Namespace) -> int:
    """Do what was asked."""
    from gcs.access.token_file import TokenFile, without_hash
    from gcs.settings import Settings
    from gcs.text.jsontext import dumps
    from gcs.text.utctext import utc_text

    file = TokenFile(Settings(data=args.data).tokens)
    if args.doing == "add":
        print(file.add(args.name, args.role, args.days))
    elif args.doing == "revoke":
        file.revoke(args.name)
    elif args.json:
        print(dumps([without_hash(one) for one in file.tokens()], indent=2))
    else:
        for one in file.tokens():
            end = "" if one.expires is None else f"  until {utc_text(round(one.expires * 1e9))[:16]}Z"
            print(f"{one.name}  {one.role}{end}")
    return 0
