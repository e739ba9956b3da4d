"""The command line: parse, and only then import what the command needs."""

import argparse
import contextlib
import importlib
import os
import shlex
import signal
import sys
import threading

from sensorlab.commands.options import STDOUT, parser
from sensorlab.printable import printable


def main(argv=None):
    """Run the command line; returns the exit status: 0 done, 2 bad input, 130
    interrupted, 143 told to end, 141 if nobody reads what is printed.
    """
    typed = sys.argv[1:] if argv is None else argv
    options = argparse.Namespace(checkpoint=None, typed=shlex.join(
        ["sensorid", *map(str, typed)]))

    def work():
        parser().parse_args(argv, options)
        command = importlib.import_module(f"{__name__}.{options.command}")
        aside = sys.stderr if getattr(options, "json", None) == STDOUT else sys.stdout
        with contextlib.redirect_stdout(aside):
            command.run(options)

    def kept():
        folder = options.checkpoint
        return folder and os.path.isdir(folder) and os.listdir(folder) and (
            f"; what is finished is kept in {folder}, the same command goes on from "
            "there")
    return in_one_line(work, kept, last=argv is None)


def in_one_line(work, kept=lambda: "", last=True):
    """Do the work of a program; returns its exit status. Whatever ends it early is
    said in one line.

    Parameters
    ----------
    work : function
    kept : function, optional
        Text on what an interrupt leaves.
    last : bool
        The program ends with this work.
    """
    with _interrupts_noted() as interrupts:
        try:
            if hasattr(sys.stdout, "reconfigure"):    # no letter for it: an escape
                sys.stdout.reconfigure(errors="backslashreplace")
            work()
            if sys.stdout:
                sys.stdout.flush()
            status = 0
        except KeyboardInterrupt:
            status = _interrupted(interrupts, kept)
        except Exception as problem:
            # compiled and foreign code turn interrupts into errors of their own
            status = _interrupted(interrupts, kept) if interrupts else _refused(problem)
            _drop_stdout()
        if last and _in_main_thread():    # nothing is left to interrupt
            signal.signal(signal.SIGINT, signal.SIG_IGN)
    return status


def _in_main_thread():
    return threading.current_thread() is threading.main_thread()


ENDS = {signal.SIGINT: "interrupted", signal.SIGTERM: "told to end"}


@contextlib.contextmanager
def _interrupts_noted():
    """A list of the interrupts that have come, whatever became of them: those from the
    keyboard, and requests to end, which batch systems send.
    """
    interrupts = []

    def note(number, frame):
        interrupts.append(number)
        raise KeyboardInterrupt

    def unraisable(problem):    # met where nothing can be raised: once more, later
        if isinstance(problem.exc_value, KeyboardInterrupt):
            threading.Timer(0.05, signal.pthread_kill, [
                threading.get_ident(), signal.SIGINT]).start()
        else:
            sys.__unraisablehook__(problem)
    if not _in_main_thread():
        yield interrupts
        return
    before = {number: signal.signal(number, note) for number in ENDS}
    hook, sys.unraisablehook = sys.unraisablehook, unraisable
    try:
        yield interrupts
    finally:
        sys.unraisablehook = hook
        for number, handler in before.items():
            if signal.getsignal(number) is note:
                signal.signal(number, handler)


def _refused(problem):
    """Says what was wrong with the input; anything else is raised."""
    if isinstance(problem, BrokenPipeError):    # has had enough, as `head` has
        return 141
    if isinstance(problem, MemoryError):
        problem = f"too large for the memory: {problem}"
    elif not isinstance(problem, (ValueError, OSError, OverflowError)):
        raise problem
    _say(" ".join(str(problem).split()))
    return 2


def _interrupted(interrupts, kept):
    number = interrupts[0] if interrupts else signal.SIGINT
    _say(f"{ENDS[number]}{kept() or ''}")
    return 128 + number


def _say(sentence):
    """One line on stderr, if anybody reads it."""
    try:
        print(f"sensorid: {printable(sentence)}", file=sys.stderr, flush=True)
    except OSError:
        pass


def _drop_stdout():
    """Forget what could not be printed: it would be tried again at the end."""
    try:
        if sys.stdout:
            sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
