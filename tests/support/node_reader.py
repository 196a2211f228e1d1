"""The MCAP and ROS 2 libraries that Foxglove and other viewers use, and TypeScript's compiler, run by node."""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from patience import PATIENCE_S

PROGRAM = Path(__file__).resolve().parents[1] / "interop" / "node"


@dataclass(frozen=True)
class NodeReader:
    """Libraries installed in a folder."""

    folder: Path

    @classmethod
    def installed(cls, folder: Path) -> NodeReader:
        """Install the versions of the lock file into `folder`; AssertionError without node and npm."""
        assert shutil.which("node"), "these tests need node: install Node.js 20 or newer"
        assert shutil.which("npm"), "these tests need npm: install Node.js 20 or newer with npm"
        shutil.copytree(PROGRAM, folder, dirs_exist_ok=True)
        _run(["npm", "ci", "--no-audit", "--no-fund", "--ignore-scripts"], folder)
        return cls(folder)

    def read(self, recording: Path) -> list[dict[str, Any]]:
        """Every message in the order of reception: topic, logTime, publishTime, sequence, fields.

        64-bit integers, NaN and infinities are text.
        """
        with tempfile.NamedTemporaryFile(suffix=".jsonl") as target:
            _run(["node", "read.mjs", str(recording), target.name], self.folder)
            return [json.loads(line) for line in target]

    def check_types(self, project: Path) -> str:
        """What TypeScript's compiler finds wrong with a project, a line each; nothing where all is well."""
        command = ["node", str(self.folder / "node_modules/typescript/bin/tsc"), "--project", str(project)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
        assert done.returncode in (0, 1, 2), done.stderr
        assert bool(done.stdout) == bool(done.returncode), done.stderr
        return done.stdout


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stderr}"
