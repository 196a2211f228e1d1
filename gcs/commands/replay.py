"""`gcs replay`: send a recording again."""

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

NAME = "replay"
HELP = "send the bytes of a recording to a link, at the recorded pace, faster, or in lock-step with the other side"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.add_argument("file", metavar="FILE.mcap", type=Path)
    parser.add_argument("--out", metavar="URL", required=True, help="where to send, as udpout:127.0.0.1:14550")
    parser.add_argument("--speed", metavar="X", type=float, help="times the recorded pace (default 1); 0: no waiting")
    parser.add_argument("--link", metavar="NAME", help="send only what this link of the recording received")
    parser.add_argument(
        "--lock-step", action="store_true", help="send the next step only when something has come back for the last"
    )
    parser.add_argument(
        "--step-ms", metavar="MS", type=float, help="span of a step in ms; without it what was received at one time"
    )
    parser.add_argument(
        "--answer-timeout", metavar="S", type=float, help="how long to wait for an answer to a step (default 30)"
    )


def run(args: argparse.Namespace) -> int:
    """Replay and say what was sent."""
    from gcs.errors import LinkError
    from gcs.links.url import parse_url
    from gcs.text.progress import Progress

    replay = _lock_step(args) if args.lock_step else _paced(args)
    parse_url(args.out)
    with Progress() as progress:
        sent = replay(link=args.link, progress=lambda share: progress(share, "replaying"))
    if sent.unsent_bytes:
        raise LinkError(f"{args.out}: {sent.unsent_bytes} of {sent.bytes} bytes could not be sent; is someone there?")
    print(f"{sent.pieces} frames, {sent.bytes} bytes in {sent.duration_s:.1f} s")
    return 0


def _paced(args: argparse.Namespace) -> Callable[..., Any]:
    from functools import partial

    from gcs.errors import SettingsError
    from gcs.station.replay import replay_file

    if args.step_ms is not None or args.answer_timeout is not None:
        raise SettingsError("--step-ms and --answer-timeout belong to --lock-step; give that too, or leave them out")
    speed = 1.0 if args.speed is None else args.speed
    if math.isnan(speed) or speed < 0:
        raise SettingsError(f"--speed {speed}: give a factor above 0, or 0 for no waiting")
    return partial(replay_file, args.file, args.out, speed)


def _lock_step(args: argparse.Namespace) -> Callable[..., Any]:
    from functools import partial

    from gcs.errors import SettingsError
    from gcs.station.replay import replay_in_lock_step

    if args.speed is not None:
        raise SettingsError("--speed has no meaning with --lock-step, where the other side sets the pace; leave it out")
    step_ms = 0.0 if args.step_ms is None else args.step_ms
    timeout = 30.0 if args.answer_timeout is None else args.answer_timeout
    for name, value in (("--step-ms", step_ms), ("--answer-timeout", timeout)):
        if not (math.isfinite(value) and value >= 0):
            raise SettingsError(f"{name} {value}: give a number from 0 on")
    return partial(replay_in_lock_step, args.file, args.out, round(step_ms * 1e6), answer_timeout_s=timeout)
