"""Attacks by those who have a token of the service, or try to, and a fault of its catalogue: the limits must hold."""

from __future__ import annotations

import contextlib
import json
import socket
import sqlite3
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path

import httpx
from attacks import Target

from gcs.access.failures import MOST
from gcs.access.token_file import TokenFile


def _users(target: Target) -> dict[str, str]:
    """Tokens of an administrator and two operators, by name; from now on one is demanded."""
    file = TokenFile(target.folder / "data" / "tokens.json")
    tokens = {"admin": file.add("admin", "admin")}
    target.headers = {"Authorization": f"Bearer {tokens['admin']}"}
    return tokens | {name: file.add(name, "operator") for name in ("greedy", "other")}


def _by(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def large_logins(target: Target) -> None:
    """Logins of more than 4 kB, declared or not."""
    _users(target)
    body = json.dumps({"token": "x" * 60_000}).encode()
    for _ in target.until_over(0.01):
        target.expect(413, target.ask("POST", "/api/login", content=body))
        target.expect(413, target.ask("POST", "/api/login", content=iter([body])))


def wrong_tokens(target: Target) -> None:
    """A wrong token after the other from one address, and a good one from it after each."""
    tokens = _users(target)
    for number, _ in enumerate(target.until_over(0.005)):
        late = number >= MOST and target.seconds < 60.0
        target.expect(429 if late else 401, target.ask("GET", "/api/flights", headers=_by(f"wrong-{number}")))
        target.expect(200, target.ask("GET", "/api/flights", headers=_by(tokens["other"])))


def greedy_name(target: Target) -> None:
    """20 streams of events and 10 uploads of one name, held open; another name still has its own."""
    tokens = _users(target)
    stream = "GET /api/live/stream HTTP/1.1\r\nHost: 127.0.0.1\r\n"
    upload = "POST /api/flights?name=a.tlog HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 100000\r\n"

    with ExitStack() as held:

        def asked(head: str, name: str) -> int:
            """The status of what is held open, 0 where the service waits for more of it."""
            sock = held.enter_context(socket.create_connection(target.address, timeout=10.0))
            sock.sendall(f"{head}Authorization: Bearer {tokens[name]}\r\n\r\n".encode())
            if head is upload:
                sock.sendall(b"x")
                sock.settimeout(1.0)
            with contextlib.suppress(TimeoutError):
                status = int(sock.recv(100).split()[1])
                target.answers[str(status)] += 1
                return status
            return 0

        streams = [asked(stream, "greedy") for _ in range(20)]
        uploads = [asked(upload, "greedy") for _ in range(10)]
        others = asked(stream, "other"), asked(upload, "other")
        target.expect(503, *streams[8:], *uploads[3:])
        target.expect(200, *streams[:8], others[0])
        target.expect(0, *uploads[:3], others[1])
        target.note = f"{streams.count(503)} streams and {uploads.count(503)} uploads refused"
        for _ in target.until_over(0.5):
            pass


def flooded_log(target: Target) -> None:
    """An operator that deletes and restores the same flight again and again; another's change stays in the log."""
    tokens = _users(target)
    flight = str(target.flown())
    path = f"/api/flights/{flight}"
    target.expect(200, target.ask("PATCH", path, json={"title": "kept"}, headers=_by(tokens["other"])))
    with ThreadPoolExecutor(4) as pool:
        for _ in target.until_over():
            list(
                pool.map(
                    lambda _: target.ask("PATCH", path, json={"title": "x"}, headers=_by(tokens["greedy"])), range(20)
                )
            )
    lines = httpx.get(f"{target.url}/api/audit?limit=10000&changes=true", headers=target.headers, timeout=60.0).json()
    if not any(line["who"] == "other" and line["method"] == "PATCH" for line in lines):
        target.wrong.append("another's change is no more in the log")
    if len(lines) > 100 + target.seconds:
        target.wrong.append(f"{len(lines)} lines in the log")
    target.note = f"{len(lines)} lines in the log"


def damaged_catalogue(target: Target) -> None:
    """Pages of the catalogue overwritten while it runs: ready must say so, and recording goes on."""
    path = target.folder / "data" / "catalogue.sqlite"
    time.sleep(1.0)
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        (size,) = db.execute("PRAGMA page_size").fetchone()
        roots = [page for (page,) in db.execute("SELECT rootpage FROM sqlite_master WHERE rootpage > 1")]
    whole = _overwritten(path, size, roots)
    try:
        for _ in target.until_over(0.2):
            target.expect(503, target.ask("GET", "/api/ready"))
    finally:
        with path.open("r+b") as file:
            for page, content in whole.items():
                file.seek((page - 1) * size)
                file.write(content)


def _overwritten(path: Path, size: int, pages: list[int]) -> dict[int, bytes]:
    """What stood in pages of a file that hold nothing sensible now."""
    before = {}
    with path.open("r+b") as file:
        for page in pages:
            file.seek((page - 1) * size)
            before[page] = file.read(size)
            file.seek((page - 1) * size)
            file.write(b"\xa5" * size)
    return before


ATTACKS_BY_USERS = {
    "large-logins": large_logins,
    "wrong-tokens": wrong_tokens,
    "greedy-name": greedy_name,
    "flooded-log": flooded_log,
    "damaged-catalogue": damaged_catalogue,
}
