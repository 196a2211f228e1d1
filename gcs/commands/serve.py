"""`gcs serve`: the service."""

import argparse
import logging
import re
import sys
from importlib.util import find_spec
from pathlib import Path

NAME = "serve"
HELP = "record flights from links, identify them, and answer over REST"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_link_arguments, add_require_signed_argument
    from gcs.options.storage import add_storage_arguments

    parser.add_argument(
        "--connect", metavar="URL", action="append", default=[], help="link to receive from, repeatable"
    )
    parser.add_argument(
        "--forward",
        metavar="URL[,OPTION…]",
        action="append",
        default=[],
        help="link to another ground station: frames go there, and from there to the vehicles where only this machine"
        " can reach it or an option says so: receive-only, commands, systems=255+254,"
        " allow=MAV_CMD_NAV_TAKEOFF+PARAM_SET; repeatable",
    )
    add_link_arguments(parser)
    add_require_signed_argument(parser)
    parser.add_argument("--vehicle", metavar="FILE", help="vehicle file, or the name of a built-in vehicle")
    parser.add_argument("--no-identify", action="store_true", help="identify flights only when asked to")
    parser.add_argument(
        "--data", metavar="DIR", type=Path, default=Path("data"), help="folder of flights and catalogue (default data)"
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen on; other than loopback demands a token")
    parser.add_argument("--port", type=int, default=8000, help="port of the page and REST (default 8000)")
    parser.add_argument("--token-file", metavar="FILE", type=Path, help="file with the token, else GCS_TOKEN")
    parser.add_argument("--tls-cert", metavar="FILE", type=Path, help="certificate (PEM, with its chain) for HTTPS")
    parser.add_argument("--tls-key", metavar="FILE", type=Path, help="key of that certificate (PEM, no password)")
    parser.add_argument(
        "--log-format",
        choices=("text", "json"),
        default="text",
        help="log on standard error: lines to read, or an object a line, requests too (default text)",
    )
    parser.add_argument(
        "--map", metavar="FILE", type=Path, help="map beneath the track on the page: an MBTiles file of pictures"
    )
    parser.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="a Dask scheduler, whose workers identify; they need the --data folder under the same name",
    )
    parser.add_argument("--silence", metavar="S", type=float, default=10.0, help="silence that ends a flight (10)")
    add_storage_arguments(parser)
    parser.add_argument(
        "--keep-days", metavar="N", type=float, help="delete recordings older than this once they are identified"
    )
    parser.add_argument(
        "--keep-size", metavar="SIZE", help="delete the oldest identified recordings beyond this size, as 20GB"
    )


def run(args: argparse.Namespace) -> int:
    """Serve until asked to stop."""
    from gcs.access.token_file import TokenFile
    from gcs.errors import SettingsError
    from gcs.formats.map_tiles import MapTiles
    from gcs.links.url import parse_url
    from gcs.mavlink.dialect import Dialect
    from gcs.options.links import link_options
    from gcs.options.storage import storage_options
    from gcs.serve import serve
    from gcs.settings import Settings, read_token
    from gcs.station.forwardrules import parse_forward
    from gcs.text.json_log import log_as_json
    from gcs.text.sizes import parse_size

    if not 0 <= args.port <= 65535:
        raise SettingsError(f"--port {args.port}: a port is a number from 0 to 65535")
    if not args.silence > 0:
        raise SettingsError(f"--silence {args.silence}: give a time above 0 s")
    if args.keep_days is not None and not args.keep_days > 0:
        raise SettingsError(f"--keep-days {args.keep_days}: give a number of days above 0")
    if args.vehicle is None and (args.keep_days is not None or args.keep_size is not None):
        raise SettingsError("--keep-days and --keep-size delete what was identified, so they need --vehicle FILE")
    if (args.tls_cert is None) != (args.tls_key is None):
        raise SettingsError("--tls-cert and --tls-key go together: a certificate and its key")
    for url in args.connect:
        parse_url(url)
    if args.scheduler is not None:
        if not re.fullmatch(r"(tcp|tls|ws|wss)://.+:\d+", args.scheduler):
            raise SettingsError(f"--scheduler {args.scheduler}: give the address of a Dask scheduler, tcp://HOST:PORT")
        if find_spec("distributed") is None:
            raise SettingsError("--scheduler needs Dask: install the extra 'fleet'")
    if args.map is not None:
        MapTiles(args.map).close()
    link = link_options(args)
    if args.forward:
        dialect = Dialect.load(link.dialect)
        for url in args.forward:
            parse_forward(url, dialect)
    if args.log_format == "json":
        log_as_json()
    else:
        logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    settings = Settings(
        data=args.data,
        connect=tuple(args.connect),
        forward=tuple(args.forward),
        link=link,
        vehicle=args.vehicle,
        identify=not args.no_identify,
        host=args.host,
        port=args.port,
        token=read_token(args.host, args.token_file, others=bool(TokenFile(Settings(data=args.data).tokens).tokens())),
        silence_s=args.silence,
        storage=storage_options(args),
        keep_days=args.keep_days,
        map=args.map,
        scheduler=args.scheduler,
        tls_cert=args.tls_cert,
        tls_key=args.tls_key,
        json_log=args.log_format == "json",
        keep_bytes=None if args.keep_size is None else parse_size(args.keep_size, "--keep-size"),
    )
    serve(settings, _log_address if settings.json_log else _announce)
    return 0


def _log_address(url: str) -> None:
    """Say where the service answers in a line of the log, for where nothing but JSON is to be read."""
    logging.getLogger(__name__).info("serving on %s", url)


def _announce(url: str) -> None:
    """Say where the service answers; to somebody at a terminal as a code for a phone too. The token is in none."""
    from gcs.text.reach import own_addresses, qr_code, reachable

    print(f"serving on {url}", flush=True)
    others = reachable(url, own_addresses())
    for other in others:
        print(f"from other devices on this network: {other}", flush=True)
    if others and sys.stdout.isatty():
        print(qr_code(others[0]), flush=True)
