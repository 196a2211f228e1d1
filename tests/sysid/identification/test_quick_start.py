"""An identification does not wait for libraries that it seldom needs."""

import subprocess
import sys

# Each takes from a fifth of a second to a whole one to import.
SLOW = ("scipy.signal", "scipy.stats", "scipy.interpolate", "scipy.optimize")


def test_slow_libraries_are_imported_where_they_are_wanted() -> None:
    script = (
        "import gcs.analysis.postflight, sysid.identify, sysid.identification.compile_ahead, sys;"
        f"print([name for name in {SLOW!r} if name in sys.modules])"
    )
    told = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout
    assert told.strip() == "[]"
