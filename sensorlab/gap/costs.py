"""What a diagnosis costs, and how far it has come: memory before it starts, a word and
a share of the whole while it works.
"""

import contextlib
import contextvars
import ctypes
import os
import pathlib

BASE = 0.5e9          # bytes that every diagnosis takes, compiled code among them
PER_SAMPLE = 600      # bytes, and for every column beside the record
PER_COLUMN = 250
SECONDS = 1e-4        # a sample, of two cores, where one effect is found
SPARE = 0.9           # of what is available, that may be used


def memory(samples, columns=0):
    """Bytes that a diagnosis of so many samples takes, with so many columns."""
    return BASE + samples * (PER_SAMPLE + PER_COLUMN * columns)


def available():
    """Bytes of memory that are to be had; infinite where the system does not say."""
    found = [_linux(), _of_container()]
    if not any(found) and "SC_PHYS_PAGES" in getattr(os, "sysconf_names", ()):
        found = [os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")]
    return min((bytes for bytes in found if bytes), default=float("inf"))


def _linux(file="/proc/meminfo"):
    """Bytes that Linux could give without swapping, or None."""
    try:
        lines = pathlib.Path(file).read_text().splitlines()
        return next(1024 * int(line.split()[1]) for line in lines
                    if line.startswith("MemAvailable:"))
    except (OSError, StopIteration, ValueError, IndexError):
        return None


def _of_container(folder="/sys/fs/cgroup"):
    """Bytes that are left of what a container may use, or None without a limit."""
    try:
        most, used = (int((pathlib.Path(folder) / name).read_text())
                      for name in ("memory.max", "memory.current"))
    except (OSError, ValueError):
        return None
    return max(most - used, 1)


SHORTER = ("--average 10 takes means of ten samples, --from and --to a part of the "
           "record")


def check_memory(samples, columns=0):
    """Refuse a record that a diagnosis has no memory for."""
    needed, free = memory(samples, columns), available()
    if needed > SPARE * free and samples > 20000:
        raise MemoryError(
            f"a diagnosis of {samples} samples takes about {needed / 1e9:.3g} GB, "
            f"{free / 1e9:.3g} GB are available: {SHORTER}")


M_ARENA_MAX = -8    # of malloc.h


def share_heap():
    """Let all threads take memory from one heap, where glibc would give each its own: a
    fifth of what 10^6 samples take would lie there for a thread that has no use for it.
    """
    with contextlib.suppress(AttributeError, OSError, TypeError):    # no glibc
        ctypes.CDLL(None).mallopt(M_ARENA_MAX, 1)


VERY_LONG = 10**7    # samples from which on costs are said beforehand


def forewarning(samples, columns=0):
    """What a very long record will cost, as a sentence; "" if it is not very long."""
    if samples < VERY_LONG:
        return ""
    return (f"{samples} samples take about {SECONDS * samples / 60.0:.0f} min on two "
            f"cores and {memory(samples, columns) / 1e9:.3g} GB: {SHORTER}")


# ---- how far it has come

_LISTENER = contextvars.ContextVar("listener", default=None)


def say(what, parts=1.0):
    """Tell whoever listens what is done next; it makes so many parts of the work."""
    if _LISTENER.get():
        _LISTENER.get()(what, parts)


@contextlib.contextmanager
def heard_by(progress, expected):
    """Lets progress(done, all, what) hear of every `say` inside; `expected` parts are
    there to begin with, and more where more is done.
    """
    state = [0.0, 0.0, float(expected)]    # done, then of what is being done, all

    def listen(what, parts):
        state[0] += state[1]
        state[1] = parts
        state[2] = max(state[2], state[0] + parts)
        progress(state[0], state[2], what)
    token = _LISTENER.set(listen if progress else None)
    try:
        yield
        if progress:
            progress(state[2], state[2], "")
    finally:
        _LISTENER.reset(token)
