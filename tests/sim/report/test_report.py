"""The page of a stress test: well-formed, self-contained, reproducible, and shown by Chromium on narrow and wide screens."""

import csv
import re
import xml.etree.ElementTree as ElementTree
from itertools import pairwise
from pathlib import Path

import cv2
import pytest

from sim.confidence_intervals import bounds_of, mean_interval
from sim.report.page import write_report
from sim.report.plots import inline
from sim.report.rows import read_rows
from tests.sim import stress_rows
from tests.sim.browser import CHROMIUM, Browser

pytestmark = pytest.mark.render


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A result folder with everything that a page can show, and its page."""
    path: Path = tmp_path_factory.mktemp("stress")
    rows = stress_rows.density(3) + [
        stress_rows.row("terrain", k, v, s) for k, v in enumerate(("exact, all of it & <more>", "flat")) for s in range(2)
    ]
    rows[0] = stress_rows.failed(rows[0], 'ValueError: <script>alert("no")</script> & more')
    rows[4]["moments"] = [stress_rows.moment(path, "a"), stress_rows.moment(path, "bb", 2.0, cause="pose error", pictures=["moments/gone.png"])]
    rows[5]["ladder"] = None
    stress_rows.write(path, rows, tail='{"torn')
    write_report(path)
    return path


def parsed(path: Path) -> tuple[str, ElementTree.Element]:
    """The text of a page, and what it is as XML."""
    text = path.read_text(encoding="utf-8")
    return text, ElementTree.fromstring(text.removeprefix("<!DOCTYPE html>"))


def test_the_page_is_well_formed_and_needs_no_network(folder: Path) -> None:
    text, page = parsed(folder / "report.html")
    ids = [element.get("id") for element in page.iter() if element.get("id")]
    assert len(ids) == len(set(ids))
    for element in page.iter():
        assert element.tag.rpartition("}")[2] not in ("script", "link", "iframe", "object"), element.tag
        for name in ("src", "href"):
            target = element.get(name, "")
            assert target == "" or target.startswith(("data:image/jpeg;base64,", "#")), target[:80]
            assert not target.startswith("#") or target[1:] in ids, target
        for target in re.findall(r"url\(([^)]*)\)", " ".join(element.attrib.values())):
            assert target[1:] in ids, target
    assert set(re.findall(r"https?://[^\"' ]*", text)) == {"http://www.w3.org/2000/svg"}
    assert len(text.encode()) < 3_000_000
    assert "&lt;script&gt;" in text


def test_the_page_is_accessible(folder: Path) -> None:
    _, page = parsed(folder / "report.html")
    assert page.get("lang") == "en"
    tags = [element.tag.rpartition("}")[2] for element in page.iter()]
    assert all(tags.count(name) == 1 for name in ("main", "header", "footer", "nav", "h1", "title"))
    levels = [int(name[1]) for name in tags if re.fullmatch(r"h\d", name)]
    assert all(b <= a + 1 for a, b in pairwise(levels)), levels
    for element in page.iter():
        name = element.tag.rpartition("}")[2]
        if name == "img":
            assert element.get("alt")
        if name == "svg":
            assert element.get("role") == "img"
            assert len(element.get("aria-label", "")) > 40
        if name == "th":
            assert element.get("scope") in ("col", "row")
        if name == "table":
            assert element[0].tag.rpartition("}")[2] == "caption"
            assert element[0].text
        if name == "section":
            assert element.get("aria-labelledby")


def test_plots_lie_beside_it_as_pictures_and_figures(folder: Path) -> None:
    names = {path.stem for path in (folder / "report").iterdir()}
    assert {path.name for path in (folder / "report").iterdir()} == {f"{name}.{ending}" for name in names for ending in ("png", "csv")}
    assert {"overview", "first-density-mota", "density-mota", "density-ablation-mota-default", "density-misses-default", "terrain-ate-m"} <= names
    image = cv2.imread(str(folder / "report" / "density-mota.png"))
    assert image is not None
    assert image.std() > 10
    with (folder / "report" / "density-mota.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [(row["people"], row["series"], row["seeds"]) for row in rows] == [(str(p), "default", "2" if p == 5 else "3") for p in stress_rows.PEOPLE]
    (sweep, _) = read_rows(folder).sweeps()
    for row, setting in zip(rows, sweep.settings, strict=True):
        found = mean_interval(list(setting.scores("default", "mota").values()), bounds=bounds_of("mota"))
        assert [float(row[name]) for name in ("mean", "low", "high")] == [found.mean, found.low, found.high]
    with (folder / "report" / "density-misses-default.csv").open() as file:
        shares = {(row["people"], row["part"]): float(row["misses per 100"]) for row in csv.DictReader(file)}
    # 70 % of a loss of people / 125 are misses, 60 % of which are occluded.
    assert shares["100", "occluded"] == pytest.approx(100 * 0.7 * 0.6 * 0.8, rel=0.05)


def test_the_same_rows_are_the_same_bytes(tmp_path: Path) -> None:
    rows = [stress_rows.row("density", k, 5 * k, 0, ladder=None, causes=None) for k in range(2)]
    first = write_report(stress_rows.write(tmp_path / "same", rows)).read_bytes()
    assert write_report(tmp_path / "same", tmp_path / "elsewhere" / "page.html").read_bytes() == first


def test_damaged_folders_are_refused(tmp_path: Path) -> None:
    rows = stress_rows.density(1)
    rows[0]["moments"] = [stress_rows.moment(tmp_path, "a", pictures=["../../etc/passwd"])]
    with pytest.raises(ValueError, match=r"jsonl:1: picture .* lies outside the folder"):
        write_report(stress_rows.write(tmp_path / "outside", rows))
    rows[0]["moments"] = [stress_rows.moment(tmp_path / "torn", "a")]
    (tmp_path / "torn" / "moments" / "a.png").write_bytes(b"\x89PNG")
    with pytest.raises(ValueError, match=r"a\.png: not an image, or torn"):
        write_report(stress_rows.write(tmp_path / "torn", rows))
    with pytest.raises(ValueError, match="is a folder, needs a file name"):
        write_report(stress_rows.write(tmp_path / "fine", rows[1:]), tmp_path)
    assert not list(tmp_path.rglob("*.part"))
    assert not list(tmp_path.rglob("*.part.*"))
    assert not list(tmp_path.rglob("report.html"))


def test_a_page_of_failed_runs_only(tmp_path: Path) -> None:
    rows = [stress_rows.failed(row, "TimeoutError: longer than 600 s") for row in stress_rows.density(10)]
    text, _ = parsed(write_report(stress_rows.write(tmp_path, rows)))
    assert "40 × TimeoutError: longer than 600 s" in text
    assert "10 more are in results.jsonl" in text


def test_the_command_of_the_page_names_all_folders(tmp_path: Path) -> None:
    first, second = (stress_rows.write(tmp_path / name, stress_rows.density(1)) for name in ("a b", "c"))
    text, _ = parsed(write_report(first, others=[second]))
    assert f"pilsim report &#39;{first}&#39; --beside {second}</code>" in text


def test_two_svgs_share_no_id_and_numbers_of_an_axis_are_not_rounded() -> None:
    svg = '<?xml?><svg width="3" height="4" viewBox="0 0 3 4"><path id="a"/><use xlink:href="#a" style="clip-path: url(#a)"/></svg>'
    assert inline(svg, "x") == '<svg viewBox="0 0 3 4"><path id="x-a"/><use href="#x-a" style="clip-path: url(#x-a)"/></svg>'
    svg = '<svg viewBox="0 0 3.14159 4"><path d="M 0.123456 1"/><text x="1.98765">0.0125</text></svg>'
    assert inline(svg, "x") == '<svg viewBox="0 0 3.14 4"><path d="M 0.12 1"/><text x="1.98">0.0125</text></svg>'


@pytest.mark.command
@pytest.mark.skipif(CHROMIUM is None, reason="needs Chromium to open the page")
@pytest.mark.parametrize("width", [390, 1280])
def test_chromium_shows_and_prints_the_page(width: int, folder: Path) -> None:
    with Browser(width) as browser:
        browser.open(folder / "report.html")
        images = browser.evaluate("Promise.all([...document.images].map(i => i.decode().then(() => [i.naturalWidth, i.clientWidth])))")
        assert len(images) == 1
        assert all(natural == 1000 and 200 < shown <= width for natural, shown in images)
        assert browser.evaluate("document.querySelectorAll('figure svg').length") > 15
        assert browser.evaluate("[...document.querySelectorAll('figure svg')].every(s => s.getBoundingClientRect().height > 100)")
        assert browser.evaluate("[...document.links].every(a => document.getElementById(a.hash.slice(1)))")
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        beyond = (
            "[...document.body.querySelectorAll('*')].filter(e => !e.closest('.skip, thead') && e.getBoundingClientRect().right > innerWidth + 1)"
        )
        assert browser.evaluate(f"{beyond}.map(e => e.outerHTML.slice(0, 80))") == []
        smallest = "Math.min(...[...document.querySelectorAll('figure text')].map(t => t.getBoundingClientRect().height))"
        assert browser.evaluate(smallest) > 8
        assert browser.evaluate("document.title") == f"Stress test: {folder.name}"
        assert browser.complaints == []
        browser.call("Emulation.setEmulatedMedia", media="print")
        assert browser.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
        assert browser.evaluate("document.documentElement.scrollWidth") <= width
        assert len(browser.call("Page.printToPDF", printBackground=False)["data"]) > 10_000


def test_no_interval_leaves_the_range_of_its_figure(tmp_path: Path) -> None:
    """Three seeds with scores near the ends of their ranges: uncut intervals would reach from -0.02 m and to a MOTA of 1.1."""
    rows = [stress_rows.row("density", k, value, seed) for k, value in enumerate(stress_rows.PEOPLE) for seed in range(3)]
    for row in rows:
        near = 1e-3 if row["seed"] else 0.2
        row["scores"] |= dict.fromkeys(("mota", "mota_all", "idf1", "hota", "map_complete"), 1 - near)
        row["scores"] |= dict.fromkeys(("ate_m", "motp_m", "map_aligned_m", "efficiency"), near)
    write_report(stress_rows.write(tmp_path, rows))
    checked = 0
    for name in ("mota", "mota_all", "idf1", "map_complete", "ate_m", "motp_m", "map_aligned_m", "efficiency"):
        low, high = bounds_of(name)
        with (tmp_path / "report" / f"density-{name.replace('_', '-')}.csv").open() as file:
            for found in csv.DictReader(file):
                assert low is None or float(found["low"]) >= low, (name, found)
                assert high is None or float(found["high"]) <= high, (name, found)
                checked += 1
