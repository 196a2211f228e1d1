"""A small file system in memory that really fills up under `gcs record` and `gcs serve`. Needs the right to mount.

Run: python tests/campaign/full_disk.py
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from crash_trials import SENDER  # noqa: E402
from processes import free_port, start  # noqa: E402
from traffic import wait_until  # noqa: E402

from gcs.recording.reader import Recording  # noqa: E402

RATE = 4000


@contextmanager
def small_disk(size: str) -> Iterator[Path]:
    """A file system of that size."""
    with tempfile.TemporaryDirectory(prefix="full-") as name:
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", name], check=True)
        try:
            yield Path(name)
        finally:
            subprocess.run(["umount", name], check=True)


@contextmanager
def sender(port: int) -> Iterator[None]:
    """Numbered messages at a high rate."""
    process = subprocess.Popen([sys.executable, str(SENDER), str(port), str(RATE)], stdout=subprocess.DEVNULL)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def numbers(path: Path) -> list[int]:
    """The numbers of the messages in a recording, which must open without damage."""
    recording = Recording(path)
    assert recording.damage.bytes == 0, recording.damage
    return [int(number) for one in recording.columns("PING") for number in one["seq"]]


def try_record(reserve: str) -> str:
    """`gcs record` until the disk is full."""
    with small_disk("3m") as folder:
        port, path = free_port(), folder / "flight.mcap"
        url = f"udpin:127.0.0.1:{port}"
        process = start("gcs", ["record", "--connect", url, "-o", path, "--reserve", reserve])
        with process:
            wait_until(lambda: path.exists() or process.poll() is not None)
            with sender(port):
                _, error = process.communicate(timeout=300)
        found = numbers(path)
        assert process.returncode == 1
        assert found == list(range(found[0], found[0] + len(found)))
        whole = "with its index" if not Recording(path).damage.truncated else "without an index"
        return f"`gcs record --reserve {reserve}`: {len(found)} messages {whole}; says: {error.splitlines()[-1]}"


def try_serve() -> str:
    """`gcs serve` until the disk is full, and when there is room again."""
    with small_disk("3m") as folder:
        port = free_port()
        ballast = folder / "ballast"
        ballast.write_bytes(bytes(1 << 20))
        process = start(
            "gcs",
            ["serve", "--connect", f"udpin:127.0.0.1:{port}", "--data", folder, "--port", "0", "--reserve", "500kB"],
        )
        assert process.stdout is not None
        url = process.stdout.readline().split()[-1]
        with process, sender(port):
            wait_until(lambda: httpx.get(f"{url}/api/health").json()["status"] == "degraded", 300)
            time.sleep(2.0)
            told = httpx.get(f"{url}/api/health").json()
            ballast.unlink()
            wait_until(lambda: (now := httpx.get(f"{url}/api/health").json())["status"] == "ok" and now["recording"])
            process.terminate()
            process.communicate(timeout=120)
        assert process.returncode == 0
        paths = sorted(folder.glob("flights/*.mcap"))
        assert len(paths) >= 2
        found = [number for path in paths for number in numbers(path)]
        assert found == sorted(set(found))
        return f"`gcs serve`: {len(paths)} files, all whole, {told['unrecorded_bytes']} bytes unrecorded while full"


def main() -> int:
    """Print what happened."""
    print(try_record("0"))
    print(try_record("500kB"))
    print(try_serve())
    return 0


if __name__ == "__main__":
    sys.exit(main())
