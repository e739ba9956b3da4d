"""The command line: parse, and only then import what the command needs."""

import importlib
import os
import sys

from sensorlab.commands.options import parser


def main(argv=None):
    """Run the command line; returns the exit status: 0 done, 2 bad input."""
    options = parser().parse_args(argv)
    try:
        importlib.import_module(f"{__name__}.{options.command}").run(options)
        sys.stdout.flush()
    except BrokenPipeError:    # the reader has had enough, as `head` has
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141
    except (ValueError, OSError, OverflowError) as problem:
        print(f"sensorid: {' '.join(str(problem).split())}", file=sys.stderr)
        return 2
    except MemoryError as problem:
        print(f"sensorid: too large for the memory: {problem}", file=sys.stderr)
        return 2
    except (KeyboardInterrupt, SystemError) as problem:
        cause = problem    # compiled code turns an interrupt into SystemErrors
        while isinstance(cause, SystemError):
            cause = cause.__cause__
        if not isinstance(cause, KeyboardInterrupt):
            raise
        kept = getattr(options, "checkpoint", None)
        print("sensorid: interrupted" + (
            f"; finished trials are kept in {kept}, the same command goes on from there"
            if kept else ""), file=sys.stderr)
        return 130
    return 0
