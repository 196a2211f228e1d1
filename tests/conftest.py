"""Modules that several tests share lie in tests/support and are imported by their bare names."""

import os
import sys
from pathlib import Path

from hypothesis import settings

# Before anything loads the matrix library, and for all processes that tests start: on matrices as small as ours its
# threads wait for one another and take the processors from the other workers (a window of live estimates: 13 s for 4).
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

sys.path.insert(0, str(Path(__file__).parent / "support"))

# How long an example takes says how busy the machine is.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")
