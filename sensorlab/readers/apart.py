"""Reading in a process of its own: a library that crashes on a damaged file, or takes
more memory than it may, is then a sentence.

SciPy's loadmat has taken the process down on damaged files more than once:
https://github.com/scipy/scipy/issues/6072
"""

import importlib
import os
import pathlib
import pickle
import subprocess
import sys
import tempfile

MAX_BYTES = 8 * 2**30    # of memory that a reader may take
PACKAGES = dict(matlab="h5py", parquet="pyarrow", rosbag="rosbags", px4="pyulog",
                ardupilot="pymavlink")
CODE = ("import sys; sys.path[:] = sys.argv[4:]; "
        "from sensorlab.readers.apart import child; child(*sys.argv[1:4])")


def read_apart(kind, file):
    """Groups that the reader of this kind finds in a file."""
    with tempfile.TemporaryFile() as result:
        done = subprocess.run(
            [sys.executable, "-c", CODE, kind, str(file), str(MAX_BYTES), *sys.path],
            stdout=result, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL)
        if done.returncode < 0:
            raise ValueError("the file is damaged: the library that reads it crashes")
        if done.returncode:
            said = done.stderr.decode(errors="replace").strip()
            raise ValueError(said.rpartition("\n")[2])
        result.seek(0)
        return pickle.load(result)    # our own: the child wrote it


def child(kind, file, most):
    """Write the groups of a file to stdout, or what is wrong with it to stderr."""
    out = os.dup(1)    # the libraries print where they like
    os.dup2(2, 1)
    try:
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (int(most), int(most)))
    except (ImportError, ValueError, OSError):    # not on this system
        pass
    try:
        groups = importlib.import_module(f"sensorlab.readers.{kind}").read(
            pathlib.Path(file))
        with open(out, "wb") as stream:
            pickle.dump(groups, stream, protocol=5)
    except ModuleNotFoundError as missing:
        sys.exit(f"{missing.name} is needed: pip install {PACKAGES[kind]}, or "
                 "sensorid[io]")
    except MemoryError:
        sys.exit(f"it takes more than the {int(most) / 2**30:.2g} GiB of memory that "
                 "it may")
    except Exception as problem:    # each library raises its own
        sys.exit(f"{' '.join(str(problem).split())[:300]} ({type(problem).__name__})")
