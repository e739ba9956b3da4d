"""Processes that work on records side by side, each with its share of the cores."""

import contextlib
import multiprocessing
import os
import signal
import threading
from concurrent.futures import BrokenExecutor, ProcessPoolExecutor

THREADS = "NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"


def cores():
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextlib.contextmanager
def workers(number, ready=int):
    """An executor of so many processes; None for one, which is this.

    Each calls `ready` first. They share the cores, end with this process, whatever ends
    it, and leave interrupts to it.
    """
    if number == 1:
        yield None
        return
    before = set(multiprocessing.active_children())
    with _environment(dict.fromkeys(THREADS, str(max(cores() // number, 1)))):
        executor = ProcessPoolExecutor(
            number, multiprocessing.get_context("spawn"), _begin, (ready,))
        with _no_interrupts():
            try:
                for _ in range(number):    # starts them all
                    executor.submit(os.getpid)
            except (OSError, BrokenExecutor):    # none here: later ones end as well
                pass
        try:
            yield executor
        except BaseException:
            for child in set(multiprocessing.active_children()) - before:
                child.terminate()
            executor.shutdown(wait=False, cancel_futures=True)
            raise
        executor.shutdown()


def _begin(ready):
    threading.Thread(target=_end_with_parent, daemon=True).start()
    ready()


def _end_with_parent():
    multiprocessing.parent_process().join()
    os._exit(1)


@contextlib.contextmanager
def _environment(values):
    """With variables that child processes get."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _no_interrupts():
    """Processes that are started here never see an interrupt from the keyboard."""
    if not hasattr(signal, "pthread_sigmask"):    # not on this system
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
