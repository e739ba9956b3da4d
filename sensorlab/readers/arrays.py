"""NumPy files: .npy holds one array, .npz several by name."""

import zipfile

import numpy as np

from sensorlab.readers.channels import Group, fields

MAX_BYTES = 4 * 2**30    # what an archive may unpack to


def read(file):
    if file.suffix.lower() == ".npy":
        with open(file, "rb") as stream:
            np.lib.format.read_magic(stream)
        return [Group(fields(dict(error=np.load(file))))]
    with zipfile.ZipFile(file) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > MAX_BYTES:
        raise ValueError(f"unpacks to {size / 2**30:.3g} GiB, of {MAX_BYTES / 2**30:g} "
                         "GiB at most")
    arrays, refused = {}, {}
    with np.load(file) as archive:
        for name in archive.files:
            try:
                value = archive[name]
                if isinstance(value, bytes):
                    raise ValueError("it is no array of NumPy")
                arrays[name] = value
            except Exception as problem:    # zip, zlib and NumPy raise their own
                refused[name] = f"{name} cannot be read: {problem}"
    return [Group(fields(arrays), refused=refused)]
