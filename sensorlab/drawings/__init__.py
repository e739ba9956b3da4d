"""The pictures of --plot and of a diagnosis, one look for all.

    style             fonts, lines and numbers; how a picture is written
    identification    `identify`
    performance       `criteria`, for one record length and for a target
    panels            the panels of a diagnosis, each on axes of its own
    diagnosis         the picture of a diagnosis: three of them

Matplotlib is imported when a picture is drawn.
"""

from sensorlab.drawings.diagnosis import draw_diagnosis
from sensorlab.drawings.identification import draw_identify
from sensorlab.drawings.performance import draw_criteria, draw_design
from sensorlab.drawings.style import matplotlib_for_files, save

__all__ = ["draw_criteria", "draw_design", "draw_diagnosis", "draw_identify",
           "matplotlib_for_files", "save"]
