"""`python -m sim_vehicle` is the command `sim_vehicle`."""

import sys

from sim_vehicle.cli.main import main

sys.exit(main())
