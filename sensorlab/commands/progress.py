"""How far long work has come, on a terminal; nothing where nobody looks on."""

import contextlib
import shutil
import sys
import time

from numba.core import event

from sensorlab.printable import printable

BAR = 20         # characters
PATIENCE = 2.0   # s, before what remains is estimated


def looked_at():
    """Is the standard error a terminal?"""
    return bool(sys.stderr and sys.stderr.isatty())


def progress_bar(done, total):
    """So many of all are done: a bar."""
    if looked_at():
        filled = 30 * done // total
        print(f"\r[{'#' * filled}{'.' * (30 - filled)}] {done}/{total}",
              end="\n" if done == total else "", file=sys.stderr, flush=True)


@contextlib.contextmanager
def progress_line(clock=time.monotonic):
    """A function of (done, all, what) that rewrites one line with a bar, what is being
    done and about how long the rest will take; in the end the line is empty, so that
    whatever is said then has it to itself.
    """
    started = clock()

    def show(done, total, what):
        if not looked_at():
            return
        width = shutil.get_terminal_size().columns - 1
        filled = int(BAR * done / total)
        line = f"[{'#' * filled}{'.' * (BAR - filled)}] {what}{_left(done, total)}"
        print("\r" + " " * width + "\r" + (line[:width] if what else ""), end="",
              file=sys.stderr, flush=True)

    def _left(done, total):
        passed = clock() - started
        if passed < PATIENCE or not done:
            return ""
        # whatever is found is followed by another look
        return f", about {in_words(passed * (total - done) / done)} left, or more"
    try:
        yield show
    finally:
        show(1, 1, "")


def in_words(seconds):
    """A duration as one says it: "20 s", "3 min", "1.5 h"."""
    if seconds < 90.0:
        return f"{5.0 * max(round(seconds / 5.0), 1):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else (
        f"{seconds / 3600.0:.1f} h")


def say_beforehand(sentence):
    """One line before the work, on a terminal."""
    if sentence and looked_at():
        print(f"sensorid: {printable(sentence)}", file=sys.stderr, flush=True)


said = []    # once is enough


class _Compilation(event.Listener):
    """Says once that code is being compiled: a first call takes long, and looks stuck.
    """

    def on_start(self, happening):
        if not said:
            said.append(happening)
            say_beforehand("compiling for the first time: up to half a minute, once")

    def on_end(self, happening):
        pass


def announce_compilation():
    """Let the first compilation be said, if there is one."""
    event.register("numba:compile", _Compilation())
