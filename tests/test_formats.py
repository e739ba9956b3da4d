"""Files of other programs: each is written here, small, and read back."""

import struct
import sys

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import large
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat

from sensorid import identify
from sensorlab import read, read_axes
from sensorlab.readers import apart

N = 50
Y = np.random.default_rng(1).normal(size=(3, N))
TEMPERATURE = np.linspace(20.0, 25.0, N)
START = 1_700_000_000_000_000_000    # ns
STAMPS = START + 10_000_000 * np.arange(N)


def test_matlab_structures_and_both_orders_of_axes(tmp_path):
    savemat(tmp_path / "r.mat", dict(
        imu=dict(gyro=Y, accel=Y.T), time=0.01 * np.arange(N)[:, None], note="warm"))
    for name in ("imu/gyro[1]", "imu/accel[1]", "gyro[1]", "accel[1]"):
        record = read(tmp_path / "r.mat", name)
        assert_array_equal(record.error, Y[1])
        assert record.clock == "dt 10 ms from time"


def test_matlab_7_3_is_hdf5_with_the_axes_turned(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "r.mat", "w", userblock_size=512) as f:
        f["gyro"] = Y.T.copy()    # as MATLAB stores a 3 x N array
        f["imu/temperature"] = TEMPERATURE[None]
        f["dt"] = [[0.01]]
        f["#refs#/a"] = np.arange(N)
    with open(tmp_path / "r.mat", "r+b") as f:
        f.write(b"MATLAB 7.3 MAT-file")
    record = read(tmp_path / "r.mat", "gyro[2]", beside=None)
    assert_array_equal(record.error, Y[2])
    assert record.dt == 0.01
    assert_array_equal(record.columns["imu/temperature"], TEMPERATURE)


def test_parquet_with_dates_as_its_index(tmp_path):
    pytest.importorskip("pyarrow")
    pd.DataFrame(dict(gx=Y[0], gy=pd.array(Y[1], dtype="Float64"), flag=True),
                 index=pd.to_datetime(STAMPS)).to_parquet(tmp_path / "r.parquet")
    record = read(tmp_path / "r.parquet", "gx", beside=None)
    assert_array_equal(record.error, Y[0])
    assert record.clock == "dt 10 ms from time, dates"
    assert_array_equal(record.columns["gy"], Y[1])


def imu_messages(store):
    """Messages of sensor_msgs/msg/Imu in the types of a store."""
    types = store.types
    header, time = types["std_msgs/msg/Header"], types["builtin_interfaces/msg/Time"]
    vector, turn = (types[f"geometry_msgs/msg/{name}"] for name in (
        "Vector3", "Quaternion"))
    sequence = {} if "seq" not in header.__dataclass_fields__ else dict(seq=0)
    for k in range(N):
        yield types["sensor_msgs/msg/Imu"](
            header(stamp=time(*map(int, divmod(STAMPS[k], 10**9))), frame_id="imu",
                   **sequence),
            turn(0.0, 0.0, 0.0, 1.0), np.zeros(9), vector(*Y[:, k].tolist()),
            np.zeros(9), vector(0.0, 0.0, 9.81), np.zeros(9))


def write_ros1(file):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer(file) as bag:
        topic = bag.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        for k, message in enumerate(imu_messages(store)):
            bag.write(topic, int(STAMPS[k]) + 10**6 * (k % 3), store.serialize_ros1(
                message, "sensor_msgs/msg/Imu"))


def write_ros2(folder, plugin):
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Writer(folder, version=9, storage_plugin=StoragePlugin[plugin]) as bag:
        topic = bag.add_connection("/imu/data", "sensor_msgs/msg/Imu", typestore=store)
        for k, message in enumerate(imu_messages(store)):
            bag.write(topic, int(STAMPS[k]) + 10**6 * (k % 3), store.serialize_cdr(
                message, "sensor_msgs/msg/Imu"))


@pytest.mark.parametrize("kind", [
    "bag", large("sqlite3"), large("mcap"), large("folder")])
def test_ros_bags_of_both_versions_and_mcap(tmp_path, kind):
    pytest.importorskip("rosbags")
    if kind == "bag":
        write_ros1(source := tmp_path / "r.bag")
    else:
        write_ros2(source := tmp_path / "r", "MCAP" if kind == "mcap" else "SQLITE3")
        if kind == "mcap":
            (source,) = source.glob("*.mcap")
        elif kind == "sqlite3":
            (source,) = source.glob("*.db3")
    for name in ("imu/data/angular_velocity/y", "angular_velocity/y",
                 "data/angular_velocity[1]", "/imu/data/angular_velocity/y"):
        record = read(source, name)
        assert_array_equal(record.error, Y[1])
        assert record.clock == "dt 10 ms from header/stamp [ns]"
    assert_array_equal(read(source, "imu/angular_velocity/y").error, Y[1])
    with pytest.raises(ValueError, match="may be .*orientation/y, .*velocity/y"):
        read(source, "imu/y")
    assert [r.column[-1] for r in read_axes(source, "imu/angular_velocity")] == [*"xyz"]
    with pytest.raises(ValueError, match="angular_velocity is not one of .*velocity/x, "
                       ".*velocity/y, .*velocity/z"):
        read(source, "angular_velocity")


def write_ulog(file):
    """Two messages of the published format: https://docs.px4.io/main/en/dev_log/
    ulog_file_format"""
    def part(kind, content):
        return struct.pack("<HB", len(content), ord(kind)) + content
    fields = b"sensor_combined:uint64_t timestamp;float[3] gyro_rad;"
    content = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)
    content += part("B", bytes(40)) + part("F", fields)
    content += part("A", struct.pack("<BH", 0, 7) + b"sensor_combined")
    content += part("A", struct.pack("<BH", 1, 8) + b"sensor_combined")
    for k in range(N):
        for number in (7, 8):
            content += part("D", struct.pack("<HQ3f", number, 10_000 * k + 5,
                                             *((number - 6) * Y[:, k])))
    file.write_bytes(content)


def test_logs_of_px4(tmp_path):
    pytest.importorskip("pyulog")
    write_ulog(tmp_path / "r.ulg")
    record = read(tmp_path / "r.ulg", "sensor_combined/gyro_rad[1]")
    assert_allclose(record.error, Y[1], rtol=1e-6)
    assert record.clock == "dt 10 ms from timestamp [us]"
    second = read(tmp_path / "r.ulg", "sensor_combined#1/gyro_rad[1]").error
    assert_allclose(second, 2 * Y[1], rtol=1e-6)
    with pytest.raises(ValueError, match="may be .*combined/gyro_rad.1., sensor_combine"
                                         "d#1/gyro_rad.1.: choose one"):
        read(tmp_path / "r.ulg", "gyro_rad[1]")
    with pytest.raises(ValueError, match="rad is not one of sensor_combined/gyro_rad"):
        read(tmp_path / "r.ulg", "sensor_combined/gyro_rad")
    assert [r.column for r in read_axes(tmp_path / "r.ulg", "sensor_combined/gyro_rad")
            ] == [f"sensor_combined/gyro_rad[{k}]" for k in range(3)]


def fmt(number, length, name, types, columns):
    """A message of DataFlash that says what another holds."""
    return b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", number, length, name, types, columns)


def write_dataflash(file):
    """FMT and IMU messages, see LogStructure.h of ArduPilot's AP_Logger."""
    content = fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    content += fmt(130, 3 + 8 + 1 + 12, b"IMU", b"QBfff", b"TimeUS,I,GyrX,GyrY,GyrZ")
    content += fmt(131, 3 + 8 + 4, b"BARO", b"Qf", b"TimeUS,Temp")
    for k in range(N):
        content += b"\xa3\x95\x82" + struct.pack("<QB3f", 10_000 * k + 5, 0, *Y[:, k])
        content += b"\xa3\x95\x83" + struct.pack("<Qf", 10_000 * k + 7, TEMPERATURE[k])
    file.write_bytes(content)


def test_logs_of_ardupilot(tmp_path):
    pytest.importorskip("pymavlink")
    write_dataflash(tmp_path / "r.bin")
    record = read(tmp_path / "r.bin", "IMU/GyrY")
    assert_allclose(record.error, Y[1], rtol=1e-6)
    assert record.clock == "dt 10 ms from TimeUS"


def test_logs_of_ardupilot_with_several_sensors(tmp_path):
    """Messages as LogStructure.h of AP_InertialSensor has them since version 4.0: one
    for every sensor, with its number, and the time when the sample was taken.
    """
    pytest.importorskip("pymavlink")
    content = fmt(128, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    content += fmt(129, 44, b"FMTU", b"QBNN", b"TimeUS,FmtType,UnitIds,MultIds")
    content += fmt(130, 32, b"GYR", b"QBQfff", b"TimeUS,I,SampleUS,GyrX,GyrY,GyrZ")
    content += b"\xa3\x95\x81" + struct.pack("<QB16s16s", 0, 130, b"s#sEEE", b"F-F000")
    rng = np.random.default_rng(2)
    for k in range(N):
        for number in (0, 1):
            content += b"\xa3\x95\x82" + struct.pack(
                "<QBQ3f", 10_000 * k + int(rng.integers(90_000)), number,
                10_000 * k + 5, *((1 + number) * Y[:, k]))
    (tmp_path / "r.bin").write_bytes(content)
    for name, times in (("GYR/GyrZ", 1), ("GYR#1/GyrZ", 2)):
        record = read(tmp_path / "r.bin", name, beside=None)
        assert_allclose(record.error, times * Y[2], rtol=1e-6)
        assert record.clock == "dt 10 ms from SampleUS"    # not when it was written
        assert list(record.columns) == ["I"]
    assert [r.column for r in read_axes(tmp_path / "r.bin", "GYR")] == [
        f"GYR/Gyr{axis}" for axis in "XYZ"]


@pytest.mark.parametrize("suffix", [".mat", ".h5", ".parquet", ".bag", ".db3", ".mcap",
                                    ".ulg", ".bin"])
@pytest.mark.parametrize("content", [b"", bytes(range(256)) * 4])
def test_files_of_something_else_get_one_sentence(tmp_path, suffix, content):
    file = tmp_path / ("r" + suffix)
    file.write_bytes(content)
    with pytest.raises(ValueError) as refused:
        read(file)
    assert str(refused.value).startswith(str(file)) and "\n" not in str(refused.value)


def test_a_library_that_is_not_there_is_named(tmp_path, monkeypatch):
    (tmp_path / "pyulog.py").write_text("raise ModuleNotFoundError(name='pyulog')")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    (tmp_path / "r.ulg").write_bytes(b"ULog")
    with pytest.raises(ValueError, match="pyulog is needed: pip install pyulog, or "
                                         r"sensorid\[io\]"):
        read(tmp_path / "r.ulg")


@pytest.mark.large
def test_a_reader_takes_no_more_memory_than_it_may(tmp_path, monkeypatch):
    savemat(tmp_path / "r.mat", dict(error=np.zeros(2 * 10**8, np.uint8)),
            do_compression=True)
    monkeypatch.setattr(apart, "MAX_BYTES", 5 * 10**8)
    with pytest.raises(ValueError, match="takes more than the 0.47 GiB of memory"):
        read(tmp_path / "r.mat", dt=1.0)


def test_objects_of_python(tmp_path):
    times = pd.date_range("2026-01-31", periods=N, freq="10ms", tz="UTC")
    table = pd.DataFrame(dict(gx=Y[0], temperature=TEMPERATURE), index=times)
    record = read(table, "gx", beside=None)
    assert_array_equal(record.error, Y[0])
    assert record.dt == pytest.approx(0.01) and record.file == "DataFrame"
    assert_array_equal(record.columns["temperature"], TEMPERATURE)
    for name in ("gx", "error"):    # the only channel beside its times
        assert_array_equal(read(table["gx"], name).error, Y[0])
    array = xr.DataArray(Y, dims=("axis", "time"), coords=dict(
        time=times.tz_convert(None)), name="gyro")
    assert_array_equal(read(array, "gyro[2]").error, Y[2])
    assert_array_equal(read(array.to_dataset(), "gyro[2]").error, Y[2])
    assert_array_equal(read(array[0].rename("gx")).error, Y[0])
    assert repr(read(table["gx"])) == (
        "<Recording Series, column gx: 50 samples, dt 10 ms from time, dates>")
    assert read(dict(error=Y[0], time=0.5 * np.arange(N))).dt == 0.5
    assert_array_equal(read(Y[1].tolist(), dt=0.01).error, Y[1])
    with pytest.raises(ValueError, match="a int is no source of records"):
        read(5)


def test_fields_of_an_array_are_columns(tmp_path):
    rows = np.rec.fromarrays([0.5 * np.arange(N), Y[0]], names="time,error")
    np.save(tmp_path / "r.npy", rows)
    np.savez(tmp_path / "r.npz", imu=rows, other=Y[1])
    for source, name in ((rows, "error"), (tmp_path / "r.npy", "error"),
                         (tmp_path / "r.npz", "imu/error")):
        record = read(source, name)
        assert_array_equal(record.error, Y[0])
        assert record.dt == 0.5


def test_a_name_given_twice_is_refused():
    table = pd.DataFrame(np.c_[Y[0], Y[1]], columns=["gx", "gx"])
    with pytest.raises(ValueError, match="the table has gx more than once"):
        read(table, "gx", dt=0.5)


def test_what_is_masked_is_missing():
    masked = np.ma.masked_array(Y[0], Y[0] > 1.0)
    with pytest.raises(ValueError, match="NaN or empty values"):
        read(masked, dt=1.0)
    error = read(masked, dt=1.0, allow_missing=True).error
    assert_array_equal(np.isnan(error), masked.mask)
    found, same = (identify(y, 1.0).best.mean for y in (masked, error))
    assert_array_equal(found, same)


def test_a_clock_and_a_dt_that_disagree_are_refused():
    arrays = dict(error=Y[0], time=0.01 * np.arange(N), dt=0.02)
    with pytest.raises(ValueError, match="time says dt = 0.01 s, but the scalar dt is"):
        read(arrays)
    with pytest.raises(ValueError, match="time says dt = 0.01 s, but 0.02 s is given"):
        read(arrays, dt=0.02)
    assert read(arrays, dt=0.01).clock == "dt 10 ms as given"
    guessed = dict(error=Y[0], time=10 * np.arange(N))    # ms, if nothing says more
    assert read(guessed).dt == 0.01 and read(guessed, dt=10.0).dt == 10.0
    with pytest.raises(ValueError, match="time says dt = 0.01 s, but 0.02 s is given"):
        read(guessed, dt=0.02)
    jumping = dict(arrays, time=np.random.default_rng(0).uniform(size=N))
    assert read(jumping, dt=0.02).clock == "dt 20 ms as given"
    assert read(dict(arrays, dt=0.01)).clock == "dt 10 ms from time"
    assert read(dict(arrays, time="noon")).clock == "dt 20 ms"
    assert read(dict(arrays, dt=np.full(N, 0.02))).clock == "dt 10 ms from time"


def test_rows_and_columns_are_told_by_the_longer_side():
    for gyro in (Y, Y.T):
        record = read(dict(gyro=gyro, dt=0.1), "gyro[2]")
        assert_array_equal(record.error, Y[2])
    many = np.random.default_rng(0).normal(size=(40, 20))    # as simulate writes them
    assert_array_equal(read(dict(error=many, dt=1.0), "error[30]").error, many[30])


def test_control_characters_of_names_are_not_printed_raw(tmp_path):
    (tmp_path / "r\x1b[2J.csv").write_text("time,err\x1bor,a\x07\n" + "".join(
        f"{k},{y},1\n" for k, y in enumerate(Y[0])))
    record = read(tmp_path / "r\x1b[2J.csv", "err\x1bor", beside=None)
    assert record.heading.isprintable() and "err\\x1bor" in record.heading
    assert list(record.columns) == ["a\\x07"]
