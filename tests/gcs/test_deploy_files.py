"""What a machine is set up with: the unit of systemd, the rules of udev, the example of their settings."""

from __future__ import annotations

import configparser
import re
import shlex
import shutil
import subprocess
from pathlib import Path

from gcs.cli import build_parser

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


class _Unit(dict[str, object]):
    """Keys may come again: each keeps all of its values, a line each."""

    def __setitem__(self, key: str, value: object) -> None:
        if isinstance(value, list) and key in self:
            value = [*self[key], *value]  # type: ignore[misc]
        super().__setitem__(key, value)


def unit() -> configparser.RawConfigParser:
    made = configparser.RawConfigParser(strict=False, dict_type=_Unit, interpolation=None, comment_prefixes="#")
    made.optionxform = str  # type: ignore[method-assign,assignment]
    made.read(DEPLOY / "gcs.service")
    return made


def test_the_unit_is_supervised_and_confined() -> None:
    service = dict(unit()["Service"])
    wanted = {
        "Type": "notify", "NotifyAccess": "main", "DynamicUser": "yes", "SupplementaryGroups": "dialout",
        "StateDirectory": "gcs", "ProtectSystem": "strict", "ProtectHome": "yes", "PrivateTmp": "yes",
        "NoNewPrivileges": "yes", "CapabilityBoundingSet": "", "KillMode": "mixed", "Restart": "on-failure",
        "RestrictAddressFamilies": "AF_INET AF_INET6 AF_UNIX", "DevicePolicy": "closed",
        "SystemCallFilter": "@system-service", "RestrictNamespaces": "yes",
    }  # fmt: skip
    assert {name: service[name] for name in wanted} == wanted
    assert int(service["WatchdogSec"]) >= 30
    assert "MemoryDenyWriteExecute" not in service  # numba
    assert {line.split()[0] for line in service["DeviceAllow"].splitlines()} >= {"char-ttyACM", "char-ttyUSB"}


def test_the_unit_runs_a_command_that_there_is_with_the_options_of_the_example() -> None:
    lines = (DEPLOY / "gcs.env.example").read_text(encoding="utf-8").splitlines()
    settings = dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))
    assert settings["GCS_TOKEN"] == ""
    (options,) = shlex.split(settings["GCS_OPTIONS"])
    program, *words = unit()["Service"]["ExecStart"].replace("%S", "/var/lib").replace("$GCS_OPTIONS", options).split()
    assert Path(program).name == "gcs"
    args = build_parser().parse_args(words)
    assert (args.data, args.log_format) == (Path("/var/lib/gcs"), "json")
    assert "/dev/autopilot,115200" in args.connect


def test_systemd_understands_the_unit(tmp_path: Path) -> None:
    assert {"Unit", "Service", "Install"} <= set(unit())
    assert unit()["Service"]["Type"] == "notify"
    if shutil.which("systemd-analyze") is None:
        return  # the sections and the type are what can be looked at without it
    text = (DEPLOY / "gcs.service").read_text(encoding="utf-8").replace("/opt/gcs/bin/gcs", "/bin/true")
    (tmp_path / "gcs.service").write_text(text, encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", str(tmp_path / "gcs.service")], capture_output=True, text=True, check=False
    )
    assert "gcs.service" not in done.stderr, done.stderr


def test_the_rules_of_udev_name_the_board_and_keep_modemmanager_away() -> None:
    text = (DEPLOY / "70-autopilot.rules").read_text(encoding="utf-8").replace("\\\n", "")
    rules = [line for line in text.splitlines() if line and not line.startswith("#")]
    part = re.compile(r'\s*[A-Z_]+(\{\w+\})?(==|!=|\+=|=)"[^"]*"\s*')
    for rule in rules:
        assert all(part.fullmatch(one) for one in rule.split(",")), rule
    vendors = {vendor for rule in rules for vendor in re.findall(r'ATTRS\{idVendor\}=="(\w+)"', rule)}
    ignored = {vendor for rule in rules for vendor in re.findall(r'ATTR\{idVendor\}=="(\w+)"', rule)}
    assert vendors == ignored >= {"26ac", "2dae", "3162", "1209"}
    assert any('SYMLINK+="autopilot"' in rule for rule in rules)
    assert any('GROUP="dialout"' in rule and 'ID_MM_PORT_IGNORE}="1"' in rule for rule in rules)
    assert set(re.findall(r'GOTO="(\w+)"', text)) == set(re.findall(r'LABEL="(\w+)"', text))
