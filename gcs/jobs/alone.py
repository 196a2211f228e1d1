"""Imported first where programs are forked from (`gcs.jobs.programs`), before any matrix library: a process that has
threads cannot be forked safely, and these are such libraries'.
"""

import os

os.environ.update(dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"))
