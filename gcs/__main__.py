"""`python -m gcs` is the command `gcs`."""

import sys

from gcs.cli import main

sys.exit(main())
