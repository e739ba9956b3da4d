"""The axes of a sensor, and what was recorded beside them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sensorlab import read, read_axes
from sensorlab.readers.axes import find_several, vectors
from sensorlab.readers.channels import Group
from sensorlab.readers.covariates import beside

N = 40
Y = np.random.default_rng(3).normal(size=(3, N))
IMU = dict(time=0.01 * np.arange(N), gx=Y[0], gy=Y[1], gz=Y[2], ax=Y[2], ay=Y[0],
           az=Y[1], mx=Y[0], my=Y[2], mz=Y[1], temperature=np.arange(N) / 7.0)


def found(groups, wanted):
    return [c.name for c in find_several(groups, wanted)]


def test_axes_are_named_alike_but_for_the_axis():
    for names in (["gx", "gy", "gz"], ["w_RS_S_x", "w_RS_S_y", "w_RS_S_z"],
                  ["rollspeed", "pitchspeed", "yawspeed"],
                  ["q/x", "q/y", "q/z", "q/w"], [f"q[{k}]" for k in range(4)]):
        assert vectors(["ax", "ay", "max", *names, "time"]) == [names]


def test_all_axes_of_inertial_sensors_are_found():
    table = [Group(IMU)]
    assert found(table, "all") == ["gx", "gy", "gz", "ax", "ay", "az"]
    assert found(table, "gz, ax,gz") == ["gz", "ax"]
    arrays = [Group(dict(gyro=Y, accel=Y.T, heat=Y[0]))]
    assert found(arrays, "all") == [f"{s}[{k}]" for s in ("gyro", "accel")
                                    for k in range(3)]
    assert found(arrays, "accel,heat") == ["accel[0]", "accel[1]", "accel[2]", "heat"]
    topics = [Group({f"{part}/{axis}": Y[0] for part in ("angular_velocity", "vector")
                     for axis in "xyz"}, name="imu"),
              Group(dict(x=Y[0], y=Y[0], z=Y[0]), name="vehicle_local_position")]
    assert found(topics, "all") == [f"imu/angular_velocity/{axis}" for axis in "xyz"]
    assert found(topics, "vector") == [f"imu/vector/{axis}" for axis in "xyz"]
    assert found(topics, "imu") == found(topics, "all")
    assert found([Group(dict(error=Y, time=Y[0]))], "all") == [
        f"error[{k}]" for k in range(3)]


@pytest.mark.parametrize("groups, wanted, message", [
    ([Group(dict(a=Y[0], b=Y[1]))], "all", "no names differ by x, y, z alone among a"),
    ([Group(dict(gyro=Y), name=name) for name in ("one", "two")], "all",
     "there are axes in one, two: choose"),
    ([Group(dict(gyro=Y), name=name) for name in ("one", "two")], "gyro",
     r"gyro may be one/gyro\[0\], one/gyro"),
    ([Group(IMU)], "gx,nothing", "no column 'nothing'")])
def test_what_is_open_is_asked(groups, wanted, message):
    with pytest.raises(ValueError, match=message):
        find_several(groups, wanted)


def test_other_axes_are_no_covariates_unless_asked_for():
    record = read(IMU, "gy", beside=None)
    assert [*record.columns] == ["temperature"]
    assert set(record.axes) == set(IMU) - {"time", "gy", "temperature"}
    asked = read(IMU, "gy", beside=["ax", "T=temperature"])
    assert [*asked.columns] == ["ax", "T"] and asked.axes == ()
    whole = read(dict(gyro=Y, rate=Y + 1.0, accel=Y, dt=1.0), "gyro[1]", beside=None)
    assert {*whole.columns} == {"rate", "rate_x", "rate_z"} and whole.axes == ("accel",)
    for names in ("rate_{}", "Rate.{}", "rate_{} [deg/s]", "{}_rate"):
        moved = read(dict(IMU, **{names.format(axis): Y[k] + 1.0 for k, axis in
                                  enumerate("xyz")}), "gy", beside=None)
        assert {*moved.columns} == {"temperature", "rate", "rate_x", "rate_z"}
        for name, row in dict(rate=1, rate_x=0, rate_z=2).items():
            assert_array_equal(moved.columns[name], Y[row] + 1.0)
        assert len(moved.axes) == len(IMU) - 3
    whole = read(dict(gyro=Y, rate=Y + 1.0, dt=1.0), "gyro[2]", beside=None)
    assert {*whole.columns} == {"rate", "rate_x", "rate_y"}
    assert_array_equal(whole.columns["rate_y"], Y[1] + 1.0)
    phone = {f"{name}_{axis}": Y[k] for name in ("rate", "acceleration")
             for k, axis in enumerate("xyz")}    # what it measures itself
    assert read(dict(phone, dt=1.0), "rate_x", beside=None).columns == {}
    turning = dict(IMU, **{f"q/{axis}": Y[0] for axis in "xyzw"})
    assert [*read(turning, "gy", beside=None).columns] == ["temperature"]
    turning.update({f"rate_{axis}": Y[0] + 1.0 for axis in "xyz"})
    assert [*read(turning, "q/w", beside=None).columns] == ["temperature"]
    assert found([Group(turning)], "all") == ["gx", "gy", "gz", "ax", "ay", "az"]
    # beside an error there are no axes: every column may be its cause
    assert {*read(dict(IMU, error=Y[0]), beside=None).columns} == {*IMU} - {"time"}


def test_one_of_several_axes_that_is_no_record_is_told():
    gyro = Y.copy()
    gyro[1] = 2.0
    x, y, z = read_axes(dict(gyro=gyro, dt=1.0))
    assert_array_equal(x.error, gyro[0])
    assert "the record is constant (2)" in y.problem and y.column == "gyro[1]"


def topics(start=0.0, rate=1.0):
    """An IMU at 100 Hz from 5 s on, and a thermometer, in topics of their own."""
    t = start + np.arange(0.0, 12.0, 1.0 / rate)
    stamps = (1_000_000 * (5.0 + 0.01 * np.arange(500))).astype(np.int64)
    return [Group({"timestamp [us]": stamps, "gyro": np.tile(Y, 15)[:, :500]}, "imu",
                  "timestamp [us]"),
            Group({"time [ms]": 1000.0 * t, "temperature [degC]": 20.0 + 0.5 * t},
                  "baro", "time [ms]")]


def test_columns_of_other_topics_are_taken_at_the_times_of_the_record():
    groups = topics()
    (channel, *_) = find_several(groups, "gyro")
    columns, _ = beside(groups, channel, ["baro/temperature"])
    assert_allclose(columns["temperature"], 22.5 + 0.005 * np.arange(500), atol=1e-6)
    columns, _ = beside(groups, channel, ["T=temperature"])
    assert [*columns] == ["T"]


def test_columns_of_another_time_tell_nothing():
    groups = topics(start=7.0)
    (channel, *_) = find_several(groups, "gyro")
    with pytest.raises(ValueError, match="baro/temperature .degC. was not recorded in "
                       "40 % of the time of imu/gyro"):
        beside(groups, channel, ["baro/temperature"])
    with pytest.raises(ValueError, match="in other topics: no column 'humidity' among"):
        beside(groups, channel, ["humidity"])
    no_clock = [groups[0], Group(dict(temperature=Y[0]), "baro")]
    with pytest.raises(ValueError, match="baro/temperature has no clock"):
        beside(no_clock, channel, ["temperature"])
    empty = [groups[0], groups[1]._replace(arrays={
        "time [ms]": np.arange(9.0), "temperature": np.full(9, np.nan)})]
    with pytest.raises(ValueError, match="baro/temperature holds no numbers"):
        beside(empty, channel, ["temperature"])


@pytest.mark.parametrize("change, why", [
    (lambda cells: cells[:7] + ["ERR"] + cells[8:], "'ERR' in column temperature"),
    (lambda cells: ["cold"] * len(cells), "'cold' in column temperature"),
    (lambda cells: [""] * len(cells), "temperature holds no number")])
def test_a_column_that_cannot_be_used_is_not_left_out_without_a_word(
        change, why, tmp_path):
    cells = change([f"{x:.4g}" for x in IMU["temperature"]])
    file = tmp_path / "r.csv"
    file.write_text("time,error,label,temperature\n" + "".join(
        f"{t:g},{y:g},left,{cell}\n" for t, y, cell in zip(IMU["time"], Y[0], cells)))
    record = read(file, beside=None)
    assert not record.columns
    (said,) = record.left_out    # of text none is expected
    assert why in said


def test_columns_of_another_length_or_kind_are_said(tmp_path):
    for x, why in ((np.arange(N - 3.0), "has 37 values for 40 samples"),
                   (Y[1] > 0.0, "holds no real numbers"),
                   (Y[1] + 1j, "holds no real numbers")):
        record = read(dict(error=Y[0], dt=0.1, temperature=x, g=9.81,
                           K=np.eye(3)), beside=None)
        assert record.left_out == (f"temperature {why}",) and not record.columns
    assert not read(dict(error=Y[0], dt=0.1), beside=None).left_out


def test_a_temperature_has_its_name_however_it_is_written():
    for name in "Temperature", "TEMPERATURE [degC]", "temp", "Temp (C)":
        source = {"error": Y[0], "dt": 0.1, name: Y[1]}
        assert [*read(source, beside=None).columns] == ["temperature"]
        assert [*read(source, beside=[name]).columns] == ["temperature"]
    two = {"error": Y[0], "dt": 0.1, "temperature": Y[1], "temp": Y[2]}
    assert [*read(two, beside=None).columns] == ["temperature", "temp"]
