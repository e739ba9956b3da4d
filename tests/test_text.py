"""CSV and its dialects."""

import bz2
import datetime
import gzip
import lzma

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sensorlab import read
from sensorlab.readers import text
from sensorlab.readers.clocks import duration

Y = np.round(np.random.default_rng(1).normal(size=40), 6)
ROWS = list(zip(np.round(0.02 * np.arange(40), 2).tolist(), Y.tolist()))


def dialect(separator, header, decimal=".", end="\n", tail=""):
    lines = [header] + [f"{t}{separator}{y}{tail}".replace(".", decimal)
                        for t, y in ROWS]
    return end.join(lines) + end


@pytest.mark.parametrize("content", [
    dialect(",", "time,error"),
    dialect(", ", "time, error"),
    dialect(";", "time;error"),
    dialect(";", "time;error", decimal=","),
    dialect("\t", "time\terror", decimal=","),
    dialect("\t", "time\terror"),
    dialect("|", "time|error"),
    dialect("  ", "time error"),
    dialect(" ", "  time   error", decimal=","),
    dialect(",", "time,error", end="\r\n"),
    dialect(",", "time,error", tail=","),
    dialect(",", "time,error,", tail=","),
    dialect(",", "# a gyro, 50 Hz\n\n# warm\ntime,error"),
    dialect(",", '# a 5" gyro\n#time,error') + '#"\n',
    dialect(",", '# a 5" gyro\ntime,error,n', tail=',"in"'),
    dialect(",", "% time,error"),
    dialect(",", '"time","error"'),
    dialect(",", "time [s],error [deg/h]"),
    dialect(",", "Time (s),error (deg/h)"),
    dialect(",", "time,error,note", tail=',"sun, wind"'),
    dialect(",", "time,error", tail="  # fine"),
    dialect(",", "\ufefftime,error"),
    dialect(",", "time,error").replace(f",{Y[7]}\n", f",{Y[7]}\n\n# knocked\n"),
    dialect(",", "// a gyro\ntime,error"),
    dialect(";", "sep=;\ntime;error", decimal=","),
    dialect(",", "Device,XY-3\nRate,50\n\ntime,error"),
    dialect(",", "time,error\ns,deg/h"), dialect("\t", "time\terror\n[s]\t[deg/h]"),
    dialect(";", "logger of the bench\ntime;error\ns;deg/h", decimal=","),
    '"time","error"\n' + "".join(f'"{t}","{y}"\n'.replace(".", ",") for t, y in ROWS)])
def test_every_dialect_gives_the_same_record(tmp_path, content):
    (tmp_path / "r.csv").write_text(content, encoding="utf-8", newline="")
    record = read(tmp_path / "r.csv")
    assert_array_equal(record.error, Y)
    assert_allclose(record.dt, 0.02, rtol=1e-9)
    assert record.unit in ("", "deg/h")


def test_utf_16_and_packed_files_are_read(tmp_path):
    content = dialect(";", "time;error", decimal=",")
    for encoding in "utf-16", "utf-16-le", "utf-16-be":    # the latter without a mark
        (tmp_path / "r.txt").write_text(content, encoding=encoding)
        assert_array_equal(read(tmp_path / "r.txt").error, Y)
    for kind, pack in ((".gz", gzip), (".bz2", bz2), (".xz", lzma)):
        (tmp_path / f"r.csv{kind}").write_bytes(pack.compress(content.encode()))
        assert_array_equal(read(tmp_path / f"r.csv{kind}").error, Y)


def test_euroc_names_its_columns_in_a_comment(tmp_path):
    """The header of the EuRoC MAV dataset, imu0/data.csv."""
    start = 1403636579758555392
    (tmp_path / "data.csv").write_text(
        "#timestamp [ns],w_RS_S_x [rad s^-1],a_RS_S_x [m s^-2]\n" + "".join(
            f"{start + 5_000_000 * i},{y},{9.81 + 0.01 * y}\n"
            for i, y in enumerate(Y)))
    record = read(tmp_path / "data.csv", "w_RS_S_x", beside=None)
    assert_array_equal(record.error, Y)
    assert record.unit == "rad s^-1" and list(record.columns) == ["a_RS_S_x"]
    assert record.heading.endswith("column w_RS_S_x [rad s^-1]: 40 samples, dt 5 ms "
                                   "from #timestamp [ns]".replace("#", ""))


def test_rostopic_names_its_columns_after_a_percent_sign(tmp_path):
    """As written by `rostopic echo -b FILE -p /imu`."""
    (tmp_path / "imu.csv").write_text(
        "%time,field.header.seq,field.angular_velocity.x,field.angular_velocity.y\n"
        + "".join(f"{1403636579758555392 + 5_000_000 * i},{i},{y},0\n"
                  for i, y in enumerate(Y)))
    for name in ("angular_velocity/x", "angular_velocity.x", "angular_velocity[0]"):
        record = read(tmp_path / "imu.csv", name)
        assert_array_equal(record.error, Y)
        assert record.clock == "dt 5 ms from time, taken as ns"


@pytest.mark.parametrize("sign", "%#")
def test_a_header_in_a_comment_counts_beside_columns_of_text(tmp_path, sign):
    (tmp_path / "imu.csv").write_text(
        sign + "time,field.header.frame_id,field.angular_velocity.x\n" + "".join(
            f"{1403636579758 + 5 * i}000000,imu,{y}\n" for i, y in enumerate(Y)))
    assert_array_equal(read(tmp_path / "imu.csv", "angular_velocity.x").error, Y)


def test_a_file_without_a_header_goes_by_number(tmp_path):
    (tmp_path / "one.txt").write_text("\n".join(map(str, Y)))
    assert_array_equal(read(tmp_path / "one.txt", dt=0.02).error, Y)
    (tmp_path / "two.txt").write_text(dialect(",", "").lstrip())
    assert_array_equal(read(tmp_path / "two.txt", "2", dt=0.02).error, Y)


def test_the_dates_of_a_logger_are_a_clock(tmp_path):
    (tmp_path / "r.csv").write_text("timestamp,error\n" + "".join(
        f"2026-01-31T12:00:{i / 50:09.6f}+01:00,{y}\n" for i, y in enumerate(Y)))
    record = read(tmp_path / "r.csv")
    assert record.clock == "dt 20 ms from timestamp, dates"
    assert_array_equal(record.error, Y)


@pytest.mark.parametrize("names, form, dt, said", [
    ("date,time", "%Y-%m-%d,%H:%M:%S.%f", 0.5, "date and time"),
    ("Date,Time", "%Y%m%d,%H%M%S.%f", 0.5, "Date and Time"),
    ("secs,nsecs", "{0:.0f},{1:.0f}", 0.5, "secs and nsecs"),
    ("stamp.sec,stamp.nanosec", "{0:.0f},{1:.0f}", 0.5, "stamp.sec and stamp.nanosec"),
    ("time", "%H:%M:%S.%f", 0.5, "time, dates"),
    ("time", "%d.%m.%Y %H:%M:%S", 60.0, "time, dates"),
    ("utc", "%H%M%S.%f", 0.5, "utc, read as hhmmss"),
    ("utc", "%Y%m%d%H%M%S", 60.0, "utc, read as YYYYMMDDhhmmss"),
    ("date", "%Y%m%d", 86400.0, "date, read as YYYYMMDD")])
def test_times_as_loggers_write_them(tmp_path, names, form, dt, said):
    """From 10 s before midnight on."""
    first = datetime.datetime(2026, 1, 30, 23, 59, 50)
    lines = [names + ",error"]
    for i, y in enumerate(Y):
        now = first + datetime.timedelta(seconds=i * dt)
        whole, part = divmod(1.7e9 + i * dt, 1.0)
        lines.append(f"{now.strftime(form).format(whole, 1e9 * part)},{y}")
    (tmp_path / "r.csv").write_text("\n".join(lines))
    record = read(tmp_path / "r.csv", allow_missing=True, beside=None)
    assert record.clock == f"dt {duration(dt)} from {said}" and not record.columns
    assert_array_equal(record.error, Y)


@pytest.mark.parametrize("content, message", [
    ("", "no header and no row"), ("# nothing\n", "no header and no row"),
    ("time,error\x00\n1,2\n", "holds NUL bytes"),
    ("time,error\n1,2\n1,2,3\n", "line 3 has 3 cells, not 2"),
    ('time,error\n1,"2\n', "EOF inside string"),
    (dialect(";", "time;error", decimal=",").replace("0,04", "1.000,04"),
     "'1.000,04' in column time"),
    (dialect(",", "time,error").replace("0.04,", "0x1,"), "line 4: '0x1' in column t"),
    (dialect(",", "time,error,error", tail=",1"), "names error more than once")])
def test_what_is_no_table_gets_one_sentence(tmp_path, content, message):
    (tmp_path / "r.csv").write_text(content)
    with pytest.raises(ValueError, match=message):
        read(tmp_path / "r.csv")


def test_a_packed_file_is_not_unpacked_beyond_what_it_may(tmp_path, monkeypatch):
    with gzip.open(tmp_path / "r.csv.gz", "wt") as stream:
        stream.write("time,error\n" + "0,0\n" * 10**6)
    monkeypatch.setattr(text, "MAX_BYTES", 2**20)
    with pytest.raises(ValueError, match="unpacks to more than 0.000977 GiB"):
        read(tmp_path / "r.csv.gz")
    (tmp_path / "s.csv.gz").write_bytes((tmp_path / "r.csv.gz").read_bytes()[:500])
    with pytest.raises(ValueError, match="read as .gz: Compressed file ended"):
        read(tmp_path / "s.csv.gz")
