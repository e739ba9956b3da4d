"""MATLAB files, v5 by SciPy and v7.3 (HDF5) by h5py; other HDF5 files too."""

import numpy as np

from sensorlab.readers.channels import Group

HDF5 = b"\x89HDF\r\n\x1a\n"    # HDF5 File Format Specification, II.A: at 0, 512, ...


def read(file):
    with open(file, "rb") as stream:
        start = stream.read(520)
    if HDF5 in (start[:8], start[512:]):
        return [Group(_hdf5(file))]
    from scipy.io import loadmat
    return [Group(dict(_arrays(loadmat(file, simplify_cells=True))))]


def _arrays(tree, above=""):
    """Arrays of a tree of structures by their path."""
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from _arrays(value, f"{above}{name}/")
        elif not name.startswith("__"):
            yield above + name, np.asarray(value)


def _hdf5(file):
    """Arrays of an HDF5 file by their path, each with MATLAB's order of axes."""
    import h5py
    arrays = {}

    def keep(name, item):
        if (isinstance(item, h5py.Dataset) and not name.startswith("#refs#")
                and item.attrs.get("MATLAB_class") != b"char"):
            arrays[name] = np.squeeze(np.asarray(item[()]).T)
    with h5py.File(file, "r") as content:
        content.visititems(keep)
    return arrays
