"""One look for all pictures: fonts, lines, plain numbers, room for every label.

To draw changes no state of Matplotlib: a notebook keeps its own.
"""

import functools
import pathlib

from sensorid import write_whole

INK, PALE = "#222222", "#8a8f98"
BEFORE, AFTER = "#c2452d", "#1f63a6"    # the simulator, and with what was found

STYLE = {
    "font.size": 10.0, "axes.labelsize": 10.0, "axes.titlesize": 10.5,
    "axes.titlelocation": "left", "axes.titleweight": "bold",
    "legend.fontsize": 9.0, "legend.frameon": False,
    "axes.spines.top": False, "axes.spines.right": False,
    "axes.edgecolor": "#666666", "axes.linewidth": 0.7,
    "axes.labelcolor": INK, "text.color": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.grid": True, "axes.axisbelow": True, "grid.color": "#e4e4e4",
    "grid.linewidth": 0.7, "lines.linewidth": 1.4, "figure.dpi": 100,
    "axes.formatter.useoffset": False,
    "text.parse_math": False,    # a $ of a name is none of ours
    "svg.fonttype": "path", "svg.hashsalt": "sensorid"}


def matplotlib_for_files():
    """matplotlib.pyplot, or a sentence on what to install."""
    try:
        import matplotlib
    except ImportError:
        raise ValueError("--plot needs Matplotlib: pip install matplotlib") from None
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    return plt


def styled(draw):
    """A function that draws, in the one look."""
    @functools.wraps(draw)
    def inside(*args, **options):
        import matplotlib
        with matplotlib.rc_context(STYLE):
            return draw(*args, **options)
    return inside


def new_figure(width, height, columns=1):
    """A figure, inches, and a list of its axes side by side."""
    from matplotlib.figure import Figure
    fig = Figure(figsize=(width, height), layout="constrained")
    return fig, list(fig.subplots(1, columns, squeeze=False)[0])


LONG_LABEL = 30    # letters of a label that fills a line of the legend


def legend_above(ax, title=""):
    """A legend above the axes, where it hides nothing; its title is theirs."""
    handles, labels = ax.get_legend_handles_labels()
    if handles:
        columns = 1 if max(map(len, labels)) > LONG_LABEL else 2
        ax.legend(title=title, loc="lower left", bbox_to_anchor=(0.0, 1.0),
                  alignment="left", ncols=columns, borderaxespad=0.2, handlelength=1.6,
                  columnspacing=1.2, title_fontproperties=dict(weight="bold"))
    elif title:
        ax.set_title(title)


RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def plain_number(x):
    """A number as a tick says it: 0.02, 30, 10⁻⁵, 2·10⁶."""
    if not x or 1e-4 < abs(x) < 1e5:
        return f"{x:.10g}"
    digits, exponent = f"{x:e}".split("e")
    digits = f"{float(digits):g}"
    return ("" if digits == "1" else f"{digits}·") + "10" + str(
        int(exponent)).translate(RAISED)


def with_plain_logs(fig):
    """Put plain numbers on the logarithmic axes of a figure: 10, 20, 30."""
    from matplotlib.ticker import LogFormatter, LogFormatterSciNotation

    class Plain(LogFormatter):
        def __call__(self, x, pos=None):
            return plain_number(x) if super().__call__(x, pos) else ""
    for ax in fig.axes:
        for axis in (ax.xaxis, ax.yaxis):
            if isinstance(axis.get_major_formatter(), LogFormatterSciNotation):
                axis.set_major_formatter(Plain())
                axis.set_minor_formatter(Plain(labelOnlyBase=False,
                                               minor_thresholds=(1.5, 0.6)))
    return fig


@styled
def save(fig, file):
    """Write a picture whole or not at all."""
    with_plain_logs(fig)
    kind = pathlib.Path(file).suffix[1:].lower()
    write_whole(file, lambda stream: fig.savefig(stream, format=kind, dpi=150))
