"""The picture of a diagnosis: the record, its Allan deviation, and what shows the
effect.
"""

import pathlib
import textwrap

from sensorlab.drawings.panels import of_allan, of_evidence, of_record
from sensorlab.drawings.style import legend_above, new_figure, styled
from sensorlab.gap.words import headline


@styled
def draw_diagnosis(d, view, record, unit):
    """Three panels that say it all, under the verdict."""
    fig, (left, middle, right) = new_figure(15.0, 5.2, 3)
    name = f"{pathlib.Path(record.file).name}, {record.column}"
    fig.suptitle(textwrap.fill(f"{name}: {headline(d)}", 120), x=0.01, ha="left",
                 fontsize=13.0, fontweight="bold")
    of_record(left, d, view, unit)
    of_allan(middle, d, view, unit)
    titles = "The record", "Allan deviation", of_evidence(right, d, view, unit)
    for ax, title in zip((left, middle, right), titles):
        legend_above(ax, title)
    return fig
