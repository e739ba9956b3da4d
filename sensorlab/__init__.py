"""The laboratory around `sensorid`: why a simulated record differs from a real one,
other algorithms, files, pictures, the command line.

    tables         sentences and tables as text of any width
    gap/           effect, size and place of what a simulator lacks; see `sensorlab.gap`
    rivals         other algorithms, the Cramer-Rao bound
    planning       how long must be recorded
    rest           where a sensor was not moved
    readers/       recordings as files and programs hold them
    units          units of the field, parameters as data sheets quote them
    foreign/       data sheets and other programs' files as model files
    modelfiles     simulators as files hold them; modelschema says what is in them
    exports/       the sensor in the format of other programs
    drawings/      the pictures of --plot and of a diagnosis
    pages/         a diagnosis as one page of HTML
    several/       many records in one go: the axes of a sensor, a folder
    commands/      the command line

What is public can be taken from here; it is imported when it is asked for.
"""

import importlib

_HOME = dict(
    ALGORITHMS="rivals", estimation_bound="rivals",
    at_rest="rest", diagnose_many="several", identify_many="several",
    read="readers", read_axes="readers", Recording="readers", Record="readers",
    read_record="readers",
    Model="modelfiles", read_model="modelfiles", model_text="modelfiles",
    simulator_from="gap.blackbox",
    CATALOGUE="gap.catalogue", Effect="gap.effects", Found="gap.effects",
    Scene="gap.effects", Simulator="gap.members", simulate_effects="gap.draws",
    diagnose="gap.diagnosis", augmented="gap.augmented",
    report="gap.report", table="gap.words", page="pages")
__all__ = list(_HOME)


def __getattr__(name):
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
