"""Long runs over many seeds that can be stopped and go on: one JSON line per finished flight, in a file per sources."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def fingerprint(packages: Sequence[str], *others: Path) -> str:
    """Of the sources that make an estimate: loaded modules of these packages, the vehicles and other files."""
    files = {
        Path(module.__file__)
        for key, module in sys.modules.items()
        if key.split(".")[0] in packages and getattr(module, "__file__", None)
    }
    files |= set((ROOT / "sim_vehicle" / "vehicles").iterdir()) | set(others)
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:12]


def keyed_lines(path: Path, key: str) -> dict[Any, dict[str, Any]]:
    """Finished lines of JSON by one of their entries; a last line that was cut off does not count."""
    found = {}
    if path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            try:
                line = json.loads(text)
            except json.JSONDecodeError:
                continue
            found[line[key]] = line
    return found


def read_lines(path: Path) -> dict[int, dict[str, Any]]:
    """Finished flights by seed."""
    return keyed_lines(path, "seed")


def end_line(path: Path) -> None:
    """A line that was cut off when a run was stopped must not swallow the next one."""
    if path.exists() and (text := path.read_bytes()) and not text.endswith(b"\n"):
        path.write_bytes(text + b"\n")


def progress(done: int, of: int, seconds: float) -> None:
    """How far, and how long still, to standard error; every tenth flight only where that is no terminal."""
    left = seconds / done * (of - done)
    text = f"{done} of {of} flights, {seconds / done:.1f} s each, {left / 60.0:.0f} min left"
    if sys.stderr.isatty():
        print(f"\r{text}   ", end="\n" if done == of else "", file=sys.stderr, flush=True)
    elif done == of or done % 10 == 0:
        print(text, file=sys.stderr, flush=True)


def one_thread_each() -> None:
    """One thread for each worker's linear algebra, since the workers share the cores; they load numpy afresh."""
    os.environ.update(dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"))


def fly_missing(
    trial: Callable[..., dict[str, Any]], seeds: Iterable[int], workers: int, path: Path | None, *options: object
) -> list[dict[str, Any]]:
    """The line trial(seed, *options) of every seed, in the order of the seeds; those that `path` holds are not flown.

    A line says its "seed". path: where lines are kept, None to keep none. Raises what `trial` raises.
    """
    wanted = list(seeds)
    found = read_lines(path) if path else {}
    missing = [seed for seed in wanted if seed not in found]
    if path:
        path.parent.mkdir(parents=True, exist_ok=True)
        end_line(path)
    begin = time.monotonic()
    for count, line in enumerate(_flown(trial, missing, workers, options), 1):
        found[line["seed"]] = line
        if path:
            with path.open("a", encoding="utf-8") as sink:
                sink.write(json.dumps(line) + "\n")
        progress(count, len(missing), time.monotonic() - begin)
    return [found[seed] for seed in wanted]


def _flown(
    trial: Callable[..., dict[str, Any]], seeds: Sequence[int], workers: int, options: Sequence[object]
) -> Iterator[dict[str, Any]]:
    """Lines as they are finished."""
    # The first flight is made here, so that what it compiles is compiled once and not by every worker.
    here = seeds if workers == 1 else seeds[:1]
    for seed in here:
        yield trial(seed, *options)
    if len(here) == len(seeds):
        return
    one_thread_each()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        pending = [pool.submit(trial, seed, *options) for seed in seeds[len(here) :]]
        try:
            for future in as_completed(pending):
                yield future.result()
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise
