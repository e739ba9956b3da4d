"""python -m figures [1 ... 8] [audit] [table] [cost] [scaling] [ranks] [gap] ..."""

import argparse
import importlib
import sys
import time

import figures
from sensorlab.commands import in_one_line

PAPER = {**{str(n): f"fig{n}" for n in range(1, 7)}, "audit": "audit", "table": "table"}
NAMES = {**PAPER, "7": "fig7", "8": "fig8", **{
    name: name for name in ("cost", "scaling", "ranks", "withheld", "gap", "hostile",
                            "outside", "real", "plan")}}


def main(argv=None):
    parser = argparse.ArgumentParser(
        prog="figures", description=figures.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("which", nargs="*", metavar="FIGURE",
                        help=f"any of {', '.join(NAMES)}; by default all but "
                             "the last eleven, which tell of the method, not the paper")
    parser.add_argument("--quick", action="store_true",
                         help="a small version: 64 samples a case at 1 s instead of "
                              "500 at 0.1 s")
    options = parser.parse_args(argv)
    from sensorlab.commands import cache, progress    # an interrupt is told by now
    cache.forgive()
    progress.announce_compilation()
    unknown = [name for name in options.which if name not in NAMES]
    if unknown:
        parser.error(f"no figure {', '.join(unknown)}: choose from {', '.join(NAMES)}")
    figures.size.update(progress=progress.progress_bar)
    if options.quick:
        figures.size.update(trials=64, dt=1.0)
    started = time.perf_counter()
    for name in options.which or PAPER:
        print(f"{name}: {time.perf_counter() - started:.0f} s", file=sys.stderr)
        importlib.import_module(f"figures.{NAMES[name]}").main()
    print(f"{figures.OUTPUT}: {time.perf_counter() - started:.0f} s in all",
          file=sys.stderr)


if __name__ == "__main__":
    sys.exit(in_one_line(main))
