"""Imported where programs are forked from (`gcs.jobs.programs`): the first compiled function that is called loads the
compiler's library, and is called here.
"""

from gcs.mavlink.dialect import Dialect

Dialect.load()
