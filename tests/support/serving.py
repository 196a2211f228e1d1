"""An application behind a real server on a port of this machine."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import httpx
import uvicorn
from fastapi import FastAPI
from patience import PATIENCE_S
from traffic import wait_until

from gcs.api.connections import BoundedProtocol
from gcs.api.server import AT_A_TIME, Server
from gcs.station.supervisor import Supervisor


@contextmanager
def serving(app: FastAPI, protocol: type[BoundedProtocol] = BoundedProtocol) -> Iterator[httpx.Client]:
    """A client of the application behind a real server on a port of this machine, as `gcs serve` has it."""
    config = uvicorn.Config(app, log_level="error", http=protocol, backlog=AT_A_TIME)
    live: Any = SimpleNamespace(ending=threading.Event())
    server = Server(config, live, Supervisor(), lambda: True, lambda: None)
    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        try:
            wait_until(lambda: server.started)
            with httpx.Client(base_url=f"http://localhost:{listener.getsockname()[1]}", timeout=PATIENCE_S) as client:
                yield client
        finally:
            server.should_exit = True
            thread.join()
