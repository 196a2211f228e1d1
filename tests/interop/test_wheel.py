"""The wheel alone, in an environment of its own outside the checkout, is the whole product."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import httpx
import pytest

PACKAGES = ("flightmodel", "gcs", "sysid", "sim_vehicle")
PLAIN = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
ROOT = Path(__file__).resolve().parents[2]
FLY = ["fly", "--vehicle", "ultrastick25e", "--manoeuvre", "multisine", "--duration", "15", "--record", "flight.mcap"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    # In a copy: what a build leaves behind would be in the next one.
    for name in (*PACKAGES, "pyproject.toml", "README.md", "LICENSE"):
        source = ROOT / name
        if source.is_dir():
            shutil.copytree(source, folder / "source" / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, folder / "source" / name)
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--disable-pip-version-check", "--no-deps"]
    subprocess.run([*command, str(folder / "source"), "-w", str(folder)], check=True, timeout=300, env=PLAIN)
    (made,) = folder.glob("*.whl")
    return made


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the commands. Libraries come from this environment's folder, ours from the wheel alone."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=True)
    python = folder / "bin" / "python"
    install = [str(python), "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(install, check=True, env=PLAIN)
    site = next(folder.glob("lib/python*/site-packages"))
    (site / "libraries.pth").write_text(sysconfig.get_paths()["purelib"] + "\n", encoding="utf-8")
    return folder / "bin"


def test_the_wheel_holds_types_and_data_and_no_tests(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert {f"{package}/py.typed" for package in PACKAGES} <= set(names)
    assert "sim_vehicle/vehicles/ultrastick25e.toml" in names
    page = {path.relative_to(ROOT).as_posix() for path in (ROOT / "gcs" / "page" / "static").rglob("*.*")}
    assert "gcs/page/static/live/live.js" in page
    assert page <= set(names)
    assert not [name for name in names if name.startswith(("tests", "docs", "benchmarks", "tools"))]


def test_it_flies_identifies_reports_and_serves(installed: Path, tmp_path: Path) -> None:
    def run(program: str, *arguments: str) -> str:
        done = subprocess.run(
            [str(installed / program), *arguments], cwd=tmp_path, env=PLAIN, capture_output=True, text=True,
            timeout=300, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr[-2000:]
        return done.stdout

    where = run(
        "python", "-c", "import flightmodel, gcs, sysid; print(flightmodel.__file__, gcs.__file__, sysid.__file__)"
    )
    assert all(str(installed.parent) in place for place in where.split())
    run("sim-vehicle", *FLY)
    run("gcs", "identify", "flight.mcap", "--vehicle", "ultrastick25e", "-o", "result.json")
    run("gcs", "report", "result.json", "-o", "report.html")
    assert "CL_alpha" in (tmp_path / "report.html").read_text(encoding="utf-8")
    script = (
        "from flightmodel import *; a = Aircraft.read('ultrastick25e');"
        "print(identify(Flight.read('flight.mcap', a), a, progress=False).verdict)"
    )
    assert run("python", "-c", script).strip() in ("good", "care")
    command = [str(installed / "gcs"), "serve", "--port", "0", "--data", "data"]
    with subprocess.Popen(command, cwd=tmp_path, env=PLAIN, stdout=subprocess.PIPE, text=True) as service:
        assert service.stdout is not None
        url = service.stdout.readline().split()[-1]
        try:
            page = httpx.get(url, timeout=30.0, follow_redirects=True)
            assert page.status_code == 200
            assert "<script" in page.text
            assert httpx.get(f"{url.rstrip('/')}/api/health", timeout=30.0).status_code == 200
        finally:
            service.terminate()
            service.wait(30.0)
