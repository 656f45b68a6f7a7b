"""Memory of the process that runs networks."""

import ctypes

_MALLOC_TRIM_THRESHOLD, _MALLOC_MMAP_MAX = -1, -4


def keep_freed_memory() -> None:
    """Tell glibc to reuse large freed blocks instead of handing them back to the system.

    Networks free and ask for the same large blocks over and over; the page faults of getting them
    anew take up to half of the time on a CPU. Affects the whole process, so programs call it, not
    libraries. Does nothing on other C libraries.
    """
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except OSError:
        return
    mallopt(_MALLOC_MMAP_MAX, 0)
    mallopt(_MALLOC_TRIM_THRESHOLD, 2**31 - 1)
