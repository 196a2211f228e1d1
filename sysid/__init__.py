"""System identification on arrays: no sockets, no MAVLink, no web."""

import scipy.linalg  # noqa: F401  # its matrix library is to be loaded when the number of threads is set
from threadpoolctl import threadpool_limits

# The matrices of estimation are small: threads on them gain little, and while they wait they take the processor from
# everything else.
_LIMITS = threadpool_limits(limits=1, user_api="blas")
