import numpy as np
import pytest

from sensorlab import at_rest
from sensorlab.commands import main

RATE, N = 50, 6000    # Hz, samples


def turned(y, *times):
    """A record with turns of one second by 2000 u at some times, s, and back later."""
    y = y.copy()
    for first, last in times:
        t = np.arange(N) / RATE
        y += 2000.0 * (np.clip(t - first, 0, 1) - np.clip(t - last, 0, 1))
    return y


@pytest.fixture
def noise():
    rng = np.random.default_rng(11)
    return rng.standard_normal(N) + 0.05 * np.cumsum(rng.standard_normal(N))


def test_stretches_between_motions_are_found(noise):
    y = turned(noise, (20.0, 50.0), (90.0, 95.0))
    y[3000:3010] = np.nan
    found = at_rest(y, 1 / RATE) / RATE
    wanted = np.array([[0, 20], [21, 50], [51, 90], [96, 120]])    # between the last
    # two turns are four seconds: too near to either
    inner = found[(np.diff(found) > 3.0)[:, 0]]
    assert inner.shape == (4, 2)
    assert (inner[:, 0] >= wanted[:, 0]).all() and (inner[:, 1] <= wanted[:, 1]).all()
    assert np.abs(inner - wanted).max() < 2.0 and inner[0, 0] == 0
    assert inner[-1, 1] == N / RATE


def test_axes_are_moved_together(noise):
    y = [noise, turned(noise[::-1], (60.0, 200.0))]
    assert at_rest(y[0], 1 / RATE).tolist() == [[0, N]]
    assert at_rest(y, 1 / RATE).tolist() == at_rest(y[1], 1 / RATE).tolist()
    assert len(at_rest(y, 1 / RATE)) == 2


@pytest.mark.parametrize("error", [
    lambda t, y: y + 40.0 * (t > 50.0), lambda t, y: y + 10.0 * t,
    lambda t, y: y + 500.0 * np.exp(-t / 20.0), lambda t, y: np.round(y / 20.0) * 20.0,
    lambda t, y: y + 5000.0 * (np.arange(N) % 300 == 7),
    lambda t, y: y * (1.0 + 9.0 * (t > 90.0)), lambda t, y: np.round(y / 6) + 0.0,
    lambda t, y: y + 30.0 * (np.sin(t) > 0), lambda t, y: np.full(N, 3.0),
    lambda t, y: np.where(t < 100.0, np.nan, y),
    lambda t, y: np.where(t < 9.0, np.inf, y),
    lambda t, y: np.where(np.arange(N) % 3, -9999.0 * (np.arange(N) % 1000 == 5), y)])
def test_errors_of_a_sensor_are_no_motion(noise, error):
    y = error(np.arange(N) / RATE, noise)
    assert at_rest(y, 1 / RATE).tolist() == [[0, N]]


def test_a_short_or_slow_record_is_all_at_rest():
    assert at_rest([0.0, 100.0, 3.0], 1.0).tolist() == [[0, 3]]
    y = np.random.default_rng(2).standard_normal(100)
    assert at_rest(y, 3600.0).tolist() == [[0, 100]]


def test_what_is_no_record_is_refused():
    with pytest.raises(ValueError, match="has shape"):
        at_rest(np.zeros((2, 3, 4)), 0.1)
    with pytest.raises(ValueError, match="has shape"):
        at_rest([], 0.1)
    with pytest.raises(ValueError, match="must be a number > 0"):
        at_rest([1.0, 2.0], 0.0)


def test_commands_say_where_a_sensor_was_at_rest(noise, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    np.savez("imu.npz", gx=turned(noise, (60.0, 100.0)), gy=noise, dt=1 / RATE)
    command = "identify imu.npz --channel gx,gy --hypotheses white_noise"
    assert main([*command.split(), "--from", "10"]) == 0
    said = capsys.readouterr().err
    assert "imu.npz: gx may show a motion" in said
    start, stop = said.split("--from ")[1].split(" --to ")
    assert float(start) == 10.0 and 58.0 < float(stop) <= 60.0
    assert main([*command.split(), "--from", start, "--to", stop.strip()]) == 0
    assert "motion" not in capsys.readouterr().err
    y = noise + 3000.0 * np.sin(np.arange(N) / RATE) * (
        (np.arange(N) + 260) % 400 >= 120)
    np.savez("turned.npz", error=y, dt=1 / RATE)
    assert not len(at_rest(y, 1 / RATE))
    assert main("identify turned.npz --hypotheses white_noise".split()) == 0
    said = capsys.readouterr().err
    assert "100% of the time" in said and "--from" not in said
