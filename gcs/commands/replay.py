"""`gcs replay`: send a recording again."""

import argparse
import math
from pathlib import Path

NAME = "replay"
HELP = "send the bytes of a recording to a link at the recorded pace"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE.mcap", type=Path)
    parser.add_argument("--out", metavar="URL", required=True, help="where to send, as udpout:127.0.0.1:14550")
    parser.add_argument("--speed", metavar="X", type=float, default=1.0, help="times the recorded pace; 0: no waiting")
    parser.add_argument("--link", metavar="NAME", help="send only what this link of the recording received")


def run(args: argparse.Namespace) -> int:
    """Replay and say what was sent."""
    from gcs.errors import LinkError, SettingsError
    from gcs.linkurl import parse_url
    from gcs.progress import Progress
    from gcs.replay import replay_file

    if math.isnan(args.speed) or args.speed < 0:
        raise SettingsError(f"--speed {args.speed}: give a factor above 0, or 0 for no waiting")
    parse_url(args.out)
    with Progress() as progress:
        sent = replay_file(
            args.file, args.out, args.speed, link=args.link, progress=lambda share: progress(share, "replaying")
        )
    if sent.unsent_bytes:
        raise LinkError(f"{args.out}: {sent.unsent_bytes} of {sent.bytes} bytes could not be sent; is someone there?")
    print(f"{sent.pieces} frames, {sent.bytes} bytes in {sent.duration_s:.1f} s")
    return 0
