"""Times as loggers write them, in whole nanoseconds: dates, times of day, numbers whose
digits are those of a calendar.
"""

import numpy as np

DAY = 86_400 * 10**9    # ns
DIGITS = {"YYYYMMDDhhmmss": (True, 10**6), "YYYYMMDD": (True, 1),
          "hhmmss": (False, 10**6)}    # whether there is a date, digits of the time
GERMAN = "%d.%m.%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S"


def of_texts(name, texts):
    """Times (N,) of int64, ns, of texts: dates and times in ISO 8601 or as 31.1.2026
    12:00:00.5, since 1970; or times of day, 12:00:00.5, which run on at midnight.
    """
    import pandas
    texts = pandas.Series(list(map(str, texts)))
    day = pandas.to_timedelta(texts.where(texts.str.fullmatch(
        r"\d{1,2}:\d\d(:\d\d([.]\d+)?)?")).replace(
            r"^(\d+:\d+)$", r"\1:00", regex=True), errors="coerce")
    if day.notna().all():
        return running_on(day.to_numpy("timedelta64[ns]").astype(np.int64))
    dates = pandas.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
    for form in GERMAN:
        dates = dates.fillna(pandas.to_datetime(texts, format=form, utc=True,
                                                errors="coerce"))
    if dates.isna().any():
        k = int(dates.isna().argmax())
        raise ValueError(f"{name} of sample {k} is {texts[k][:40]!r}: neither a "
                         "number nor a date as in ISO 8601, 2026-01-31T12:00:00.5Z")
    return dates.dt.tz_localize(None).to_numpy("datetime64[ns]").astype(np.int64)


def running_on(day):
    """Times of day, ns, that go on where a new day begins."""
    return day + DAY * np.append(0, np.cumsum(np.diff(day) < -DAY // 2))


def of_digits(time):
    """Times (N,) of int64, ns, and the form of their digits, where numbers are those of
    a calendar or of a clock and as such more even than as numbers; else None.
    """
    for form in DIGITS:
        written = read_digits(time, form)
        if written is not None and _uneven(written) < _uneven(time):
            return written, form
    return None


def read_digits(time, form):
    """Times (N,) of int64, ns, of numbers in a form of digits; None where they are not
    all of this form.
    """
    dated, most = DIGITS[form]
    if not len(time) or not 0 <= time.min() <= time.max() < 1e14:
        return None
    whole = np.floor(time).astype(np.int64)
    date, clock = np.divmod(whole, most) if dated else (0, whole)
    year, month, of_month = date // 10**4, date // 100 % 100, date % 100
    hour, minute, second = clock // 10**4, clock // 100 % 100, clock % 100
    if np.any((hour > 23) | (minute > 59) | (second > 60)):
        return None
    ns = 10**9 * (60 * (60 * hour + minute) + second)
    ns += np.round(1e9 * (time - whole)).astype(np.int64)
    if not dated:
        return running_on(ns)
    if np.any((year < 1970) | (year > 2100) | (month < 1) | (month > 12)
              | (of_month < 1) | (of_month > 31)):
        return None
    months = (12 * (year - 1970) + month - 1).astype("datetime64[M]")
    return ns + DAY * (months.astype("datetime64[D]").astype(np.int64) + of_month - 1)


def _uneven(time):
    """How many steps of times are more than half a usual one off it."""
    step = np.diff(time)
    usual = np.median(step) if len(step) else 0.0
    return (np.abs(step - usual) > 0.5 * usual).sum() if usual > 0.0 else len(time)
