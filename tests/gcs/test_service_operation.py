"""`gcs serve` as an operator runs it: supervised, with a log for programs, behind its own certificate."""

from __future__ import annotations

import json
import shutil
import socket
import ssl
import subprocess
from pathlib import Path

import httpx
import pytest
from patience import PATIENCE_S
from processes import run_apart, service, start
from traffic import Vehicle, wait_until

from gcs.api.tls import tls_context
from gcs.errors import SettingsError
from gcs.serve import _listen
from gcs.settings import Settings


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate of this machine that nobody else has signed, and its key."""
    if shutil.which("openssl") is None:
        pytest.skip("there is no openssl to make a certificate with")
    folder = tmp_path_factory.mktemp("tls")
    cert, key = folder / "cert.pem", folder / "key.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes", "-days",
         "2", "-subj", "/CN=localhost", "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1",
         "-keyout", str(key), "-out", str(cert)],
        check=True, capture_output=True,
    )  # fmt: skip
    return cert, key


@pytest.mark.whole_flight
def test_a_supervisor_hears_that_it_serves_lives_and_ends_and_the_log_is_json(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as heard:
        heard.bind(str(tmp_path / "notify"))
        heard.settimeout(PATIENCE_S)
        arguments = ("serve", "--port", 0, "--data", tmp_path / "data", "--log-format", "json")
        environment = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "500000"}
        with start("gcs", arguments, **environment) as process:
            assert process.stderr is not None
            try:
                said = json.loads(process.stderr.readline())
                assert said["message"].startswith("serving on http://127.0.0.1:")
                first = heard.recv(1000).decode().splitlines()
                assert first[:2] == ["READY=1", f"MAINPID={process.pid}"]
                url = said["message"].split()[-1]
                asked = {"X-Request-ID": "from-the-test"}
                assert httpx.get(f"{url}/api/ready?token=secret", headers=asked, timeout=PATIENCE_S).status_code == 200
                assert [heard.recv(1000) for _ in range(3)] == [b"WATCHDOG=1"] * 3
                process.terminate()
                while (last := heard.recv(1000).decode()) == "WATCHDOG=1":
                    pass
                assert last.startswith("STOPPING=1")
                out, errors = process.communicate(timeout=PATIENCE_S)
            finally:
                if process.poll() is None:
                    process.kill()
    assert process.returncode == 0
    assert out == ""
    lines = [json.loads(line) for line in errors.splitlines()]
    (access,) = [line for line in lines if line["logger"] == "gcs.access"]
    assert (access["method"], access["path"], access["status"]) == ("GET", "/api/ready", 200)
    assert access["request_id"] == "from-the-test"
    assert access["ms"] > 0.0
    assert "secret" not in errors


@pytest.mark.whole_flight
@pytest.mark.parametrize("whole", [False, True])
def test_an_upload_that_a_stop_cuts_off_is_told_so_in_a_line(tmp_path: Path, whole: bool) -> None:
    data, body = tmp_path / "data", b"".join(bytes(8) + frame for frame in 500 * Vehicle().second())
    with start("gcs", ("serve", "--port", 0, "--data", data)) as process:
        assert process.stdout is not None
        try:
            port = int(process.stdout.readline().rpartition(":")[2])
            with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S) as connection:
                head = f"POST /api/flights?name=a.tlog HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}"
                connection.sendall(f"{head}\r\n\r\n".encode() + body[: None if whole else 1000])
                # `answer` is of the process that reads it.
                assert wait_until(lambda: list(data.glob("upload-*/answer" if whole else "upload-*/upload")))
                process.terminate()
                answer = b"".join(iter(lambda: connection.recv(65536), b"")).decode()
            out, errors = process.communicate(timeout=PATIENCE_S)
        finally:
            if process.poll() is None:
                process.kill()
    assert answer.startswith("HTTP/1.1 503")
    assert "the service is being stopped; ask again when it is back" in answer
    assert (process.returncode, out) == (0, "")
    assert "Traceback" not in errors
    assert len(errors.splitlines()) <= 1
    assert not list(data.glob("upload-*"))
    assert not list((data / "flights").glob("*"))


@pytest.mark.whole_flight
def test_where_a_request_is_from_says_the_proxy_that_is_believed_and_nobody_else(tmp_path: Path) -> None:
    told = {"X-Forwarded-For": "203.0.113.9", "Authorization": "Bearer wrong"}
    for believed, address in (("127.0.0.1", "203.0.113.9"), ("192.0.2.1", "127.0.0.1")):
        data = tmp_path / believed
        with service("--data", data, GCS_TOKEN="the-right-one", FORWARDED_ALLOW_IPS=believed) as url:
            assert httpx.get(f"{url}/api/flights", headers=told, timeout=PATIENCE_S).status_code == 401
        (line,) = map(json.loads, (data / "refusals.jsonl").read_text().splitlines())
        assert line["address"] == address


@pytest.mark.whole_flight
def test_what_it_writes_is_for_its_user_and_group_alone(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with service("--data", data) as url:
        body = b"".join(bytes(8) + frame for frame in Vehicle().second())
        made = httpx.post(f"{url}/api/flights?name=a.tlog", content=body, timeout=PATIENCE_S)
        assert made.status_code == 201, made.text
        files = [path for path in data.rglob("*") if path.is_file()]
        assert {"catalogue.sqlite", f"{made.json()['id']}.mcap"} <= {path.name for path in files}
        assert [path for path in (data, *data.rglob("*")) if path.exists() and path.stat().st_mode & 0o027] == []


def test_connections_wait_for_no_acknowledgement(tmp_path: Path) -> None:
    with _listen(Settings(data=tmp_path, port=0)) as listener, socket.create_connection(listener.getsockname()):
        accepted, _ = listener.accept()
        with accepted:
            assert accepted.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


@pytest.mark.whole_flight
def test_it_serves_https_with_a_certificate(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    cert, key = certificate
    with service("--data", tmp_path / "data", "--tls-cert", cert, "--tls-key", key) as url:
        assert url.startswith("https://127.0.0.1:")
        trusting = ssl.create_default_context(cafile=str(cert))
        with httpx.Client(verify=trusting, base_url=url, timeout=PATIENCE_S) as client:
            assert client.get("/api/health").json()["status"] == "ok"
            with client.stream("GET", "/api/live/stream") as events:
                assert next(events.iter_lines())
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"{url}/api/health", timeout=PATIENCE_S)  # who does not know the certificate
        with pytest.raises(httpx.HTTPError):
            httpx.get(f"http{url.removeprefix('https')}/api/health", timeout=PATIENCE_S)
        old = ssl.create_default_context(cafile=str(cert))
        old.maximum_version = ssl.TLSVersion.TLSv1_2
        assert httpx.get(f"{url}/api/health", verify=old, timeout=PATIENCE_S).status_code == 200


def test_a_certificate_that_cannot_be_used_is_said_before_anything_is_opened(
    certificate: tuple[Path, Path], tmp_path: Path
) -> None:
    cert, key = certificate
    for given, words in (
        ((tmp_path / "none.pem", key), "cannot be read"),
        ((key, cert), "cannot be used"),
        ((cert, cert), "cannot be used"),
    ):
        with pytest.raises(SettingsError, match=words):
            tls_context(*given)
    locked = tmp_path / "locked.pem"
    subprocess.run(
        ["openssl", "pkey", "-in", key, "-aes256", "-passout", "pass:secret", "-out", locked],
        check=True,
        capture_output=True,
    )
    with pytest.raises(SettingsError, match="without a password"):
        tls_context(cert, locked)
    assert tls_context(cert, key).minimum_version >= ssl.TLSVersion.TLSv1_2
    done = run_apart("gcs", "serve", "--data", tmp_path / "data", "--tls-cert", cert)
    assert done.returncode == 2
    assert "--tls-cert and --tls-key go together" in done.stderr
    assert not (tmp_path / "data").exists()
