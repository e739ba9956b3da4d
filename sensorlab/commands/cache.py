"""What Numba keeps of compiled code may be lost, by a full disk or a damaged file: that
costs time, not the result.
"""

import contextlib
import sys

from numba.core.caching import Cache

from sensorid import CACHE

said = []    # once is enough


@contextlib.contextmanager
def _go_on(cache):
    try:
        yield
    except Exception as problem:    # OSError, EOFError, whatever damaged pickles raise
        _tell(problem)


def _tell(problem):
    """Say it, once."""
    if not said:
        said.append(problem)
        print("sensorid: compiled code cannot be kept or taken up again "
              f"({problem}): going on without", file=sys.stderr)


def forgive(silent=False):
    """Let Numba go on where its cache fails, in every process that calls this."""
    if silent:    # the process that started this one has said it
        said.append(None)
    elif not CACHE:
        _tell("no folder for it can be written")
    # Numba's own guard against errors of its files, which lets all but one kind pass
    Cache._guard_against_spurious_io_errors = _go_on
