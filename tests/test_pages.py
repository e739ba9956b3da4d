"""The page of a diagnosis: complete, by itself, readable."""

import doctest
import hashlib
import html.parser
import re
import shutil
import subprocess

import numpy as np
import pytest

import sensorid
import sensorlab
from sensorlab import pages
from sensorlab.gap.report import report
from sensorlab.pages import page, provenance, typeset

KINDS = "none", "bias_step", "outliers", "quantization", "unknown", "undecided"
VOID, INLINE = {"meta", "img", "br", "link"}, {"b", "i", "sup", "sub", "span", "code"}


class Reader(html.parser.HTMLParser):
    """Text and addresses of a page whose elements all close."""

    def __init__(self, text):
        super().__init__()
        self.open, self.words, self.addresses, self.pictures = [], [], [], []
        self.feed(text)
        self.close()
        assert not self.open, self.open
        self.text = " ".join("".join(self.words).replace("\u00a0", " ").split())

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("src", "href", "srcset", "poster", "data"):
                self.addresses.append(value)
        if tag == "img":
            self.pictures.append(dict(attributes))
        if tag not in VOID:
            self.open.append(tag)
        self.words.append("" if tag in INLINE else " ")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        self.words.append("" if tag in INLINE else " ")

    def handle_data(self, data):
        if "style" not in self.open:
            self.words.append("^" * (self.open[-1:] == ["sup"]) + data)


@pytest.fixture(scope="module")
def written(answers):
    """Every page, and what a reader finds on it."""
    result = {}
    for kind, (d, record) in answers.items():
        text = page(d, record, "mg")
        result[kind] = text, Reader(text)
    return result


@pytest.mark.parametrize("kind", KINDS)
def test_a_page_needs_nothing_beside_it(written, kind):
    text, read = written[kind]
    assert len(text) < 1e6 and text.startswith("<!DOCTYPE html>")
    assert read.addresses and all(
        address.startswith("data:image/svg+xml;base64,") for address in read.addresses)
    assert "@import" not in text and not re.search(r"url\(|<script|<link", text)
    assert all(picture["alt"] for picture in read.pictures)


def as_said(x, digits=3):
    """A number as one writes it, by another way than the page."""
    text = np.format_float_positional(float(f"{x:.{digits - 1}e}"), trim="-")
    return text.replace("-", "−")


@pytest.mark.parametrize("kind", KINDS)
def test_every_number_that_matters_is_on_the_page(written, answers, kind):
    d, record = answers[kind]
    said, read = report(d, record), written[kind][1].text
    assert f"Verdict: {said['verdict']}." in read
    assert f"{said['record']['samples']} samples at 1 s, 800 s in all" in read

    def shown(x):
        assert x in read, x

    def share(x):
        return ("> 99 %" if 0.995 <= x < 1.0 else "< 1 %" if 0.0 < x < 0.005
                else f"{100 * x:.0f} %")
    gap = said["gap"]
    p = gap["p_value"]
    shown(f"{p:.2g}" if p > 1e-4 else "10^−")
    if said["found"] and gap["closed"] is not None:
        low, high = gap["closed_interval"]
        shown(f"{share(gap['closed'])} [{100 * low:.0f}, {100 * high:.0f}]".replace(
            "-", "−"))
    if said["found"]:
        shown(f"Left: {share(gap['remainder']['share'])} of the gap")
    for one in said["found"]:
        shown(f"probable, {share(one['share'])} of the gap")
        for symbol, value in one["parameters"].items():
            shown(f"{symbol} ")
            if isinstance(value["mean"], float) and value["sd"]:
                shown(f"± {as_said(value['sd'], 2)}")
    for cause in said["causes"][:6]:
        if cause["probability"] >= 0.01:
            shown(cause["effect"].replace("_", " ").replace("+", " + "))
            shown(share(cause["probability"]))
    for one in gap["drift"]:
        shown(" ".join(as_said(one[key]) for key in ("record", "simulator")))
    for one in said["where"]:
        shown(one["place"].replace("_", " "))
        shown(f"{one['before']:.1f}")


def test_each_verdict_says_its_own(written):
    read = {kind: one.text for kind, (_, one) in written.items()}
    assert "no effect is missing" in read["none"]
    assert "What was found" not in read["none"] and "Is it there?" not in read["none"]
    assert "What was found" in read["bias_step"] and "Points on the blue line" in read[
        "bias_step"]
    assert "Circles: " in read["outliers"] and "Residuals" not in read["bias_step"]
    assert "Sample by sample" in read["quantization"]
    assert "record beside the sensor whatever may move its error" in read[
        "unknown"].lower()
    assert "What explains most" in read["undecided"]
    assert "5e+03 s" not in read["undecided"] and "5000 s" in read["undecided"]
    for text in read.values():
        for word in ("nats", "log score", "likelihood", "Eq.", "None", "nan", "+-"):
            assert word not in text, word
        assert ".." not in text and "?." not in text


def test_a_page_says_where_it_comes_from(answers, tmp_path):
    file = tmp_path / "gyro <1> & \"2\".csv"
    file.write_text("time,error\n")
    d, record = answers["none"]
    origin = provenance([("record", str(file)), ("simulator", None),
                         ("records", tmp_path)], "sensorid diagnose 'a b.csv'")
    text = page(d, record._replace(file=str(file)), "mg", origin)
    assert "gyro &lt;1&gt; &amp; &#34;2&#34;.csv" in text and "<1>" not in text
    read = Reader(text).text
    assert hashlib.sha256(b"time,error\n").hexdigest() in read
    assert "sensorid diagnose 'a b.csv'" in read
    assert f"sensorid {sensorid.__version__}" in read
    assert f"numpy {np.__version__}" in read and "simulator" not in [
        what for what, *_ in origin.files]
    assert origin.files[1] == ("records", str(tmp_path), "")    # a folder has no digest


def test_examples_in_the_docstrings_are_true():
    result = doctest.testmod(pages)
    assert result.attempted and result.failed == 0


def test_what_is_typeset_is_escaped():
    assert typeset("<b>x 1e-05 m/s^2, -3 to 2024-01-31") == (
        "&lt;b&gt;x 10<sup>−5</sup> m/s<sup>2</sup>, −3 to 2024-01-31")
    assert typeset("2.5e+07 +- 3e+06") == "2.5·10<sup>7</sup> ± 3·10<sup>6</sup>"


def test_a_page_is_to_be_had_in_python(answers):
    d, record = answers["none"]
    assert "<h1>" in sensorlab.page(d, record)


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium to open the page with")
@pytest.mark.parametrize("width", [1200, 390])
def test_a_browser_shows_the_page_whole(written, tmp_path, width):
    from PIL import Image
    (tmp_path / "page.html").write_text(written["bias_step"][0])
    subprocess.run(
        [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic",
         "--no-first-run", "--disable-background-networking", "--hide-scrollbars",
         "--disable-component-update", "--disable-sync",
         f"--user-data-dir={tmp_path / 'profile'}", f"--window-size={width},3000",
         f"--screenshot={tmp_path / 'page.png'}", (tmp_path / "page.html").as_uri()],
        check=True, capture_output=True, timeout=120)
    shown = np.asarray(Image.open(tmp_path / "page.png").convert("RGB")).astype(int)
    assert shown.shape[1] >= width
    dark = shown.sum(2) < 300
    assert dark[:400].sum() > 1000    # the verdict, in dark letters on white
    assert (shown[:, -8:] > 250).all()    # nothing runs out of the page
    blue = (shown[..., 2] - shown[..., 0] > 60).sum()
    red = (shown[..., 0] - shown[..., 2] > 60).sum()
    assert blue > 500 and red > 500    # the curves of the pictures
