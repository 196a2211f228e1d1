"""`gcs record`: everything a link brings, into one file."""

import argparse
import contextlib
import sys
import time
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

    from gcs.links.link import Link
    from gcs.live.feed import LiveFeed
    from gcs.station.capture import Capture

NAME = "record"
HELP = "record what links bring into an MCAP file, until Ctrl-C or --duration"

_SILENT = "no link brought a byte; check that the vehicle sends, and to this computer's address and port"
_COUNT_EVERY_S = 10.0  # where nobody watches, each new count is another line


def problems(links: "list[Link]") -> list[str]:
    """What keeps links from bringing anything, in words."""
    return [f"{link.name}: {link.problem}" for link in links if link.problem]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    from gcs.options.links import add_link_arguments
    from gcs.options.outputs import NEW, add_output
    from gcs.options.storage import add_storage_arguments

    parser.add_argument("--connect", metavar="URL", action="append", required=True, help="link, repeatable")
    add_output(parser, "-o", "--output", metavar="FILE.mcap", kind=NEW, required=True)
    parser.add_argument("--duration", metavar="S", type=float, help="stop after this time")
    parser.add_argument(
        "--vehicle", metavar="FILE", help="vehicle file, or the name of a built-in vehicle, to keep in the recording"
    )
    parser.add_argument(
        "--live", action="store_true", help="print coefficients with standard errors every 2 s; needs --vehicle"
    )
    add_link_arguments(parser)
    add_storage_arguments(parser)


@contextlib.contextmanager
def live_feed(args: argparse.Namespace) -> "Iterator[LiveFeed | None]":
    """Identification beside the recording, which never waits for it; None without --live."""
    from gcs.live.feed import LiveFeed
    from gcs.options.links import link_options
    from gcs.settings import Settings

    if not args.live:
        yield None
        return
    settings = Settings(data=args.output.parent, link=link_options(args), vehicle=args.vehicle)
    feed = LiveFeed(settings, lambda: {args.output.stem: None})
    feed.start()
    try:
        yield feed
    finally:
        feed.stop()


def run(args: argparse.Namespace) -> int:
    """Record and say what was recorded."""
    from gcs.errors import LinkError, SettingsError
    from gcs.links.opening import open_links
    from gcs.links.url import parse_url
    from gcs.live.terminal_lines import LiveLines
    from gcs.options.links import link_options
    from gcs.options.storage import storage_options
    from gcs.station.capture import CaptureOptions, record
    from gcs.text.progress import Progress

    if args.duration is not None and not args.duration > 0:
        raise SettingsError(f"--duration {args.duration}: give a time above 0 s")
    if args.live and args.vehicle is None:
        raise SettingsError("--live identifies by the aircraft's mass, geometry and sensors: give --vehicle FILE")
    for url in args.connect:
        parse_url(url)
    options = CaptureOptions(args.output, args.duration, args.vehicle, link_options(args), storage_options(args))
    with contextlib.ExitStack() as stack:
        links = [stack.enter_context(contextlib.closing(link)) for link in open_links(args.connect)]
        feed = stack.enter_context(live_feed(args))
        lines = None if feed is None else LiveLines(feed)
        next_count, counted = 0.0, ""
        with Progress() as progress:

            def show(passed: float, capture: "Capture") -> None:
                nonlocal next_count, counted
                for line in () if lines is None else lines.due(time.monotonic()):
                    # On a terminal over the bar, which is drawn anew below.
                    print(f"\r\x1b[K{line}" if progress.watched and sys.stdout.isatty() else line, flush=True)
                if progress.watched or passed >= next_count:
                    next_count = passed + _COUNT_EVERY_S
                    counted = f"{capture.messages} messages"
                share = passed / args.duration if args.duration else 0.0
                progress(share, "; ".join([counted, *problems(links)]))

            capture = record(links, options, show, None if feed is None else feed.offer)
        if capture.bytes == 0:
            args.output.unlink()  # only what the station says of itself is in it
            raise LinkError("nothing was received: " + ("; ".join(problems(links)) or _SILENT))
    files = ", ".join(map(str, capture.parts))
    print(f"{files}: {capture.messages} messages, {capture.bytes} bytes")
    if options.link.key is not None:
        print(capture.signatures.text())
    return 0
