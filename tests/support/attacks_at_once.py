"""Most attacks from the network at once, each again and again: what none does alone two may do together."""

from __future__ import annotations

import contextlib
import itertools
import json
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Sequence
from multiprocessing.process import BaseProcess
from pathlib import Path

import httpx
from attacks import ATTACKS, Target

# Of a flood of the line itself the kernel has no room, and of the copies of a command each attack has its own opinion.
_ALONE = ("none", "flood", "forward-copies", "forward-stranger")
# The honest vehicle's messages in a second, and how long it goes on at least, s.
RATE, LEAST_S = 2000, 300.0
# How long one round of an attack goes on that would go on for ever, s.
_ROUND_S = 20.0


def all_at_once(target: Target) -> None:
    """Attacks from the network, each in a process of its own, until the time is over; none may have ended before.

    Attackers have machines of their own: here they take what processors the service and the vehicle leave.
    """
    spawn = multiprocessing.get_context("spawn")
    names = [name for name in ATTACKS if name not in _ALONE]
    attackers = [
        spawn.Process(target=_again_and_again, args=(name, target.folder, target.url, target.udp)) for name in names
    ]
    try:
        for one in attackers:
            one.start()
        for _ in target.until_over(0.5):
            pass
    finally:
        target.wrong += [f"{name} ended" for name, one in zip(names, attackers, strict=True) if not one.is_alive()]
        _end(attackers)
    for name in names:
        with contextlib.suppress(OSError):  # an attack of which nothing was answered
            target.answers.update(json.loads(_answers(target.folder, name).read_text()))
    target.note = f"{len(names)} attacks at once"


def _end(attackers: Sequence[BaseProcess]) -> None:
    for one in attackers:
        with contextlib.suppress(OSError):  # one that has ended
            os.killpg(one.pid or 0, signal.SIGKILL)
        one.join()


def _again_and_again(name: str, folder: Path, url: str, udp: int) -> None:
    """One attack in rounds, until it is ended; what it meets (a refused upload, a broken connection) is wanted."""
    os.setsid()
    os.nice(19)
    answers: Counter[str] = Counter()
    threading.Thread(target=_keep_answers, args=(answers, _answers(folder, name)), daemon=True).start()
    for number in itertools.count():
        own = folder / f"{name}-{number}"
        own.mkdir()
        target = Target(own, _ROUND_S)
        target.url, target.udp, target.answers = url, udp, answers
        with contextlib.suppress(httpx.HTTPError, OSError, KeyError, IndexError, RuntimeError, AssertionError):
            ATTACKS[name](target)
        time.sleep(0.5)


def _answers(folder: Path, name: str) -> Path:
    return folder / f"answers-{name}.json"


def _keep_answers(answers: Counter[str], path: Path) -> None:
    """Write down every second what was answered: who attacks may be ended at any time."""
    new = path.with_suffix(".new")
    while True:
        time.sleep(1.0)
        new.write_text(json.dumps(dict(answers)))
        new.replace(path)


ATTACKS_AT_ONCE = {"all-at-once": all_at_once}
