"""Data sheets and other programs' files, as the text of a model file.

    parts          a sensor axis in such a file, and what our models are called for it
    datasheet      a data sheet
    kalibr         imu.yaml, and what is like it: EuRoC, OpenVINS
    gazebo         noise blocks of SDF
    matlab         imuSensor, in the JSON of loadparams
    airsim         settings.json
    gnss_ins_sim   the dictionary of an IMU as JSON
    isaac          noise of Isaac Lab's observations, as it writes env.yaml

Each reader holds the formula by which that program draws its noise, and its source: a
mistake of the program's code can then be told from one of its keys. A file has several
axes; `FILE#PART` names one of them.
"""

import json
import pathlib
import xml.etree.ElementTree

from sensorlab.foreign import (
    airsim, datasheet, gazebo, gnss_ins_sim, isaac, kalibr, matlab)
from sensorlab.foreign.parts import interval

PROGRAMS = kalibr, gazebo, matlab, airsim, gnss_ins_sim, isaac
YAML, XML = (".yaml", ".yml"), (".sdf", ".world", ".xml", ".urdf")


def translated(file, dt=None):
    """Text of a model file, as a dict, from another program's file or a data sheet.

    Parameters
    ----------
    file : path
        Or path#part, where it holds several axes.
    dt : float, optional
        Sampling interval, s, where the file does not say it, or for another one.

    Returns
    -------
    dict
        None if the file is none of these: a model file, or no file at all.

    Raises
    ------
    ValueError
        With one sentence on what is wrong with the file.
    """
    path, part = _split(file)
    if not path.is_file():
        return None
    raw = _parsed(path)
    if raw is None or isinstance(raw, dict) and "hypotheses" in raw:
        return None
    try:
        if isinstance(raw, dict) and "datasheet" in raw:
            return datasheet.model(raw, dt)
        for program in PROGRAMS:
            parts = program.parts(raw)
            if parts:
                return _model(_chosen(parts, part), dt)
        if path.suffix.lower() == ".json":
            return None
        raise ValueError("no noise of an IMU as Kalibr, Gazebo, Isaac Lab have it")
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def _split(file):
    """Path and part; a # may be in the name of a file too."""
    path, _, part = str(file).rpartition("#")
    if not path or pathlib.Path(file).is_file():
        return pathlib.Path(file), ""
    return pathlib.Path(path), part


def _parsed(path):
    """Content of a JSON, YAML or XML file; None if it is none."""
    kind = path.suffix.lower()
    if kind in XML:
        try:
            return xml.etree.ElementTree.parse(path).getroot()
        except (xml.etree.ElementTree.ParseError, ValueError) as problem:
            raise ValueError(f"{path}: not an XML file: {problem}") from None
    try:
        text = path.read_text(encoding="utf-8-sig")
        return _yaml(text) if kind in YAML else json.loads(text)
    except (UnicodeDecodeError, RecursionError, json.JSONDecodeError) as problem:
        if kind in YAML:
            raise ValueError(f"{path}: not a YAML file: {problem}") from None
        return None    # the reader of model files says what is wrong
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def _yaml(text):
    """A YAML text; tags of Python become lists, dictionaries and texts."""
    try:
        import yaml
    except ImportError:
        raise ValueError("a YAML file needs PyYAML: pip install pyyaml") from None

    class Loader(yaml.SafeLoader):
        pass

    def plain(loader, suffix, node):
        if isinstance(node, yaml.MappingNode):
            return loader.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return loader.construct_sequence(node, deep=True)
        return loader.construct_scalar(node)
    Loader.add_multi_constructor("tag:yaml.org,2002:python/", plain)
    try:
        lines = text.splitlines()    # OpenCV's header is no YAML
        return yaml.load("\n".join(lines[lines[:1] == ["%YAML:1.0"]:]), Loader)
    except (yaml.YAMLError, TypeError, ValueError) as problem:
        raise ValueError(f"not a YAML file: {' '.join(str(problem).split())}") from None


def _chosen(parts, wanted):
    """The part whose name holds what is wanted, if there is one or all are alike."""
    found = {name: part for name, part in parts.items() if wanted in name}
    if not found:
        raise ValueError(f"no part {wanted!r}; there are {', '.join(parts)}")
    first, *others = found.values()
    if any(part.noise(0.01) != first.noise(0.01) for part in others):
        raise ValueError("several axes: name one as FILE#PART; PART is "
                         + " or ".join(found))
    return first


def _model(part, dt):
    """Text of a model file from a part."""
    dt = interval(part.dt if dt is None else dt)
    return dict(dt=dt, unit=part.unit, **part.noise(dt))
