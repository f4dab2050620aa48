import html.parser
import json
import re

import cv2
import numpy as np
import pytest

from mission.records import report as report_module
from mission.records.mission_file import read_mission
from mission.records.report import MAX_THUMBNAIL_BYTES, NotAMission, write_report
from mission.records.report_views import clock, rotor_picture
from mission.records.summary import add_truth

VOID = {"meta", "br", "img", "line", "path", "circle", "rect", "stop", "polyline"}


class Page(html.parser.HTMLParser):
    """Text, links and nesting of a page."""

    def __init__(self, path):
        super().__init__()
        self.text, self.links, self.open, self.ids = [], [], [], []
        self.feed(path.read_text())
        self.close()

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.links += [value for key, value in attrs if key in ("src", "href")]
        self.ids += [named["id"]] if "id" in named else []
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.links += [value for key, value in attrs if key in ("src", "href")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)

    @property
    def words(self):
        return re.sub(r"\s+", " ", " ".join(self.text))


@pytest.fixture
def page(mission_dir, truth):
    add_truth(mission_dir, truth)
    return Page(mission_dir / "report.html")


def test_the_page_is_well_formed(page):
    assert page.open == []


def test_the_page_needs_nothing_from_elsewhere(page, mission_dir):
    for link in page.links:
        assert link.startswith(("data:image/", "photos/", "#")), link
        if link.startswith("photos/"):
            assert (mission_dir / link).is_file()
        if link.startswith("#"):
            assert link[1:] in page.ids
    assert "url(http" not in (mission_dir / "report.html").read_text()


def test_its_figures_are_those_of_mission_json(page, mission_json):
    rotor, passes = mission_json["rotor"], mission_json["passes"]
    for figure in (
        f"{rotor['stop_angle_deg']:.2f}°",
        f"± {rotor['sigma_deg']:.2f}",
        f"{100 * mission_json['coverage']:.0f} %",
        f"{mission_json['clearance_m']['min']:.1f}",
        f"{mission_json['gsd_mm']:.2f}",
        "7:10",  # 430 s
        *(f"{one['distance_m']['mean']:.2f} m" for one in passes),
        *(f"{100 * one['coverage']:.0f} %" for one in passes),
        *(one["reason"] for one in passes[1]["unseen"]),
    ):
        assert figure in page.words


def test_the_truth_stands_beside_what_was_measured(page):
    for figure in ("61.40°", "+0.18°", "8.61 m", "17 %", "63 ms at the autopilot"):
        assert figure in page.words


def test_a_flight_that_was_not_simulated_has_no_truth(mission_dir):
    page = Page(mission_dir / "report.html")
    assert "Judged" not in page.words
    assert "61 ms when sent" in page.words


def test_repeated_warnings_are_told_once_with_their_count(page, mission_dir):
    rows = re.findall(r"<tr>.*?</tr>", (mission_dir / "report.html").read_text())
    late = [row for row in rows if "LiDAR scans come late" in row and 'class="sev warn"' in row]
    assert len(late) == 1
    assert ">3<" in late[0]
    assert "1:05" in late[0]
    assert "2:20" in late[0]


def test_photographed_and_unreachable_stretches_are_drawn_to_scale(mission_dir):
    text = (mission_dir / "report.html").read_text()
    assert f'<i style="left:{100 * 10 / 33.25:.2f}%;width:{100 * 3 / 33.25:.2f}%"' in text
    assert f'class="unseen" style="left:0.00%;width:{100 * 3.25 / 33.25:.2f}%"' in text


def test_words_of_people_cannot_become_markup(mission_dir):
    text = (mission_dir / "report.html").read_text()
    assert "<ap@example.org>" not in text
    assert "&lt;ap@example.org&gt;" in text


def test_a_blade_at_a_quarter_turn_points_to_the_viewers_right(mission_dir, mission_json):
    path = mission_dir / "mission.json"
    mission_json["rotor"]["stop_angle_deg"] = 90.0
    mission_json["rotor"]["blades"][0]["angle_deg"] = 90.0
    path.write_text(json.dumps(mission_json))
    picture = rotor_picture(read_mission(mission_dir))
    assert picture.arms[0].label_x == pytest.approx(113)
    assert picture.arms[0].turn_deg == -90
    assert picture.arc.endswith("46.00 0.00")


def test_a_refused_mission_says_why_and_shows_no_rotor(refused_dir):
    page = Page(refused_dir / "report.html")
    assert "the battery is at 20 %" in page.words
    assert "No pass was flown." in page.words
    assert "photo 3 was never delivered" in page.words
    assert "rotor" not in page.ids


def test_a_photo_that_is_gone_is_left_out(mission_dir):
    gone = next(mission_dir.glob("photos/A/SS/*.jpg"))
    gone.unlink()
    page = Page(write_report(mission_dir))
    assert not any(gone.name in link for link in page.links)


def test_no_thumbnail_is_large_however_busy_the_picture():
    noise = np.random.default_rng(2).integers(0, 256, (240, 320, 3), np.uint8)
    jpeg = report_module._jpeg(noise)
    assert len(jpeg) <= MAX_THUMBNAIL_BYTES
    assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR).shape == noise.shape
    # 300 of them, as base64, with a megabyte for the rest.
    assert 300 * MAX_THUMBNAIL_BYTES * 4 / 3 + 1e6 < 15e6


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "holds no mission.json"),
        ("{", "mission.json"),
        ("[]", "mission.json"),
        ('{"schema": 9}', "schema"),
        ('{"schema": 1}', "version"),
    ],
)
def test_what_is_no_mission_is_refused_in_one_sentence(tmp_path, content, words):
    if content is not None:
        (tmp_path / "mission.json").write_text(content)
    with pytest.raises(NotAMission, match=words) as caught:
        write_report(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_folder_that_does_not_exist_is_no_mission(tmp_path):
    with pytest.raises(NotAMission, match=r"holds no mission\.json"):
        write_report(tmp_path / "nowhere")


@pytest.mark.parametrize(("seconds", "words"), [(0, "0:00"), (65.4, "1:05"), (-5, "-0:05")])
def test_times_are_minutes_and_seconds(seconds, words):
    assert clock(seconds) == words
