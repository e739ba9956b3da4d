"""Recordings as files and programs hold them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.io import savemat

from sensorlab import read


Y = np.random.default_rng(1).normal(size=40)


def csv(path, columns, header=None):
    np.savetxt(path, np.column_stack(list(columns.values())), delimiter=",",
               fmt="%.10g", header=header or ",".join(columns), comments="")
    return path


def test_every_format_gives_the_same_record(tmp_path):
    csv(tmp_path / "a.csv",
        dict(temperature=Y * 0, error=Y, time=np.arange(40) * 0.02 + 7))
    (tmp_path / "b.csv").write_text("\ufeff# a gyro\n\"time\";\"error\"\n" + "".join(
        f"{0.02 * i:.4f};{v:.10f}\n" for i, v in enumerate(Y)))
    np.savez(tmp_path / "c.npz", error=Y, dt=0.02)
    np.savez(tmp_path / "d.npz", error=Y, time=np.arange(40) * 0.02)
    savemat(tmp_path / "e.mat", dict(error=Y, dt=0.02))
    np.save(tmp_path / "f.npy", Y)
    for file in sorted(tmp_path.iterdir()):
        record = read(file, dt=0.02 if file.suffix == ".npy" else None)
        assert_allclose(record.error, Y, atol=1e-9)
        assert_allclose(record.dt, 0.02, rtol=1e-9)


def test_gaps_in_time_become_missing_samples(tmp_path):
    keep = np.r_[0:10, 13:30, 31:40]
    file = csv(tmp_path / "r.csv", dict(time=0.5 * keep, error=Y[keep]))
    record = read(file)
    assert_array_equal(np.flatnonzero(np.isnan(record.error)), [10, 11, 12, 30])
    assert_allclose(record.error[keep], Y[keep], rtol=1e-9)


def test_empty_cells_are_missing_where_that_is_allowed(tmp_path):
    file = tmp_path / "r.csv"
    file.write_text("time,error\n" + "".join(
        f"{i},{'' if i == 7 else i % 5}\n" for i in range(30)))
    with pytest.raises(ValueError,
                       match="1 NaN or empty values, the first at sample 7"):
        read(file)
    assert np.isnan(read(file, allow_missing=True).error[7])


@pytest.mark.parametrize("wanted", ["gyro/x", "imu.angular_velocity.x"])
def test_a_channel_with_a_path_that_is_not_there_is_told_what_is(wanted):
    with pytest.raises(ValueError, match=f"no column '{wanted}' among error"):
        read(dict(error=np.arange(40.0), dt=1.0), wanted)


def test_an_uneven_record_is_refused_or_resampled(tmp_path):
    time = np.cumsum(np.random.default_rng(2).uniform(0.5, 1.5, 40))
    file = csv(tmp_path / "r.csv", dict(time=time, error=2 * time + 1))
    with pytest.raises(ValueError, match="is uneven.*--resample"):
        read(file)
    record = read(file, resample=True)
    seen = ~np.isnan(record.error)
    even = time[0] + record.dt * np.arange(len(record.error))
    off = record.error[seen] - (2 * even + 1)[seen]
    assert np.abs(off).max() <= 2 * record.dt / 2 + 1e-9
    assert set(record.error[seen]) <= set(read(file, dt=1.0).error)


@pytest.mark.parametrize("text, message", [
    ("error\n" + "1\n2\n" * 20, "neither a column time nor dt"),
    ("1,2\n3,4\n", "no column 'error' among 1, 2"),
    ("", "no header|no column"),
    ("time,rate\n0,1\n1,2\n", "no column 'error' among rate"),
    ("time,error,error\n0,1,2\n", "names error more than once"),
    ("time,error\n", "0 samples"),
    ("time,error\n0,1\n1,2\n2,3,5\n", "line 4 has 3 cells, not 2: a decimal comma"),
    ("time,error\n0,1\n1,high\n", "line 3: 'high' in column error is not a number"),
    ("time,error\n0,1\n1\n", "1 NaN or empty values, the first at sample 1"),
    ("time,error\n0,1\n", "1 samples"),
    ("time,error\n0,1\n1,2\n", "2 samples"),
    ("time,error\n" + "".join(f"{i},3\n" for i in range(50)), r"is constant \(3\)"),
    ("time,error\n" + "".join(f"{50 - i},{i}\n" for i in range(50)),
     "does not increase"),
    ("time,error\n" + "".join(f"{i},{'inf' if i == 9 else i}\n" for i in range(50)),
     "1 infinite values, the first at sample 9"),
    ("time,error\n" + "".join(f"{i},{'nan' if i == 9 else i}\n" for i in range(50)),
     "1 NaN or empty values, the first at sample 9"),
])
def test_a_bad_csv_gets_one_sentence(tmp_path, text, message):
    (tmp_path / "r.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read(tmp_path / "r.csv")


def test_other_bad_files_get_one_sentence(tmp_path):
    with pytest.raises(ValueError, match="no such file"):
        read(tmp_path / "none.csv")
    for name in ("a.npz", "b.npy", "c.mat"):
        (tmp_path / name).write_bytes(b"not an array at all")
        with pytest.raises(ValueError, match="cannot be read as"):
            read(tmp_path / name)
    np.savez(tmp_path / "d.npz", error=np.zeros((3, 50)), dt=1.0)
    with pytest.raises(ValueError, match=r"error may be error\[0\], error\[1\], err"):
        read(tmp_path / "d.npz")
    with pytest.raises(ValueError, match=r"error\[3\] is not one of error\[0\]"):
        read(tmp_path / "d.npz", "error[3]")


@pytest.mark.parametrize("arrays, message", [
    (dict(dt=[]), "dt holds 0 numbers"), (dict(dt=[0.1, 0.2]), "dt holds 2 numbers"),
    (dict(dt=0.1j), "dt does not hold real"),
    (dict(dt="fast"), "dt does not hold real"),
    (dict(time=1.0), "1 times in time for 40 samples"),
    (dict(time=np.r_[np.arange(39.0), 1e9]), "cut the gap after sample 38 out"),
    (dict(time=np.r_[np.arange(39.0), np.nan]), "time of sample 39 is nan")])
def test_wrong_times_get_one_sentence(tmp_path, arrays, message):
    np.savez(tmp_path / "r.npz", error=Y, **arrays)
    with pytest.raises(ValueError, match=message):
        read(tmp_path / "r.npz")


def test_na_is_a_missing_cell(tmp_path):
    (tmp_path / "r.csv").write_text("time,error\n" + "".join(
        f"{i},{'NA' if i == 7 else i % 5}\n" for i in range(30)) + " \n")
    record = read(tmp_path / "r.csv", allow_missing=True)
    assert len(record.error) == 30 and np.isnan(record.error[7])


def test_a_row_of_an_array_is_a_record(tmp_path):
    np.savez(tmp_path / "r.npz", gyro=np.stack([Y, 2 * Y]), dt=1.0)
    assert_array_equal(read(tmp_path / "r.npz", "gyro[1]").error, 2 * Y)
    for shaped in (Y[None], Y[:, None]):
        np.savez(tmp_path / "s.npz", error=shaped, dt=1.0)
        assert_array_equal(read(tmp_path / "s.npz").error, Y)
    csv(tmp_path / "r.csv", dict(time=np.arange(40), error=Y))
    with pytest.raises(ValueError, match=r"error\[3\] is not one of error: "):
        read(tmp_path / "r.csv", "error[3]")
