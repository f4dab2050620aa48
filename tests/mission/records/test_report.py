import html.parser
import json
import re

import cv2
import lxml.etree
import numpy as np
import pytest

from mission.records import report as report_module
from mission.records.mission_file import read_mission
from mission.records.not_inspected import not_inspected
from mission.records.report import (
    MAX_THUMBNAIL_BYTES,
    BadTemplate,
    NotAMission,
    write_report,
)
from mission.records.report_blade_map import side_maps
from mission.records.report_course import clock
from mission.records.report_facts import BadLogo
from mission.records.report_rotor import rotor_picture
from mission.records.summary import add_truth

VOID = {"meta", "br", "img"}


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
    scale = 1000 / 33.25
    # The stretch from 0.5 m is seen by the photo at 2.5 m, the one from 10 m by the one at 11 m.
    assert f'x="{scale * 0.5:.2f}" y="0" width="{scale * 3.5:.2f}"' in text
    assert f'x="{scale * 10:.2f}" y="0" width="{scale * 3:.2f}"' in text
    assert f'class="unseen" x="0.00" y="0" width="{scale * 3.25:.2f}"' in text


def test_the_map_leaves_nothing_out_and_shows_nothing_twice(mission_dir):
    side = side_maps(read_mission(mission_dir))[0]
    cells = sorted([*side.seen, *side.missed, *side.unseen], key=lambda cell: cell.x)
    ends = [0.0, *(cell.x + cell.width for cell in cells)]
    assert [cell.x for cell in cells] == pytest.approx(ends[:-1], abs=1e-6)
    assert ends[-1] == pytest.approx(1000.0)
    assert len(side.missed) == 3


def test_what_was_not_inspected_is_told_with_its_reason(mission_dir, page):
    missing = not_inspected(read_mission(mission_dir))
    reasons = {(gap.side, round(gap.from_m, 2)): gap.why for gap in missing}
    assert reasons["SS", 0.0] == "less than the clearance to tower"
    assert reasons["PS", 13.0] == "photo rejected: the blade is too dark"
    assert "Not inspected, and why" in page.words
    assert "not asked for: blade A: LE, TE" in page.words


def test_a_coarse_stretch_has_the_colour_of_a_coarse_one(mission_dir, mission_json):
    mission_json["inspection"]["max_gsd_mm"] = 0.5
    (mission_dir / "mission.json").write_text(json.dumps(mission_json))
    colours = {cell.colour for side in side_maps(read_mission(mission_dir)) for cell in side.seen}
    assert colours == {"#d68a2d"}


#: What the parser of HTML 4 does not know of HTML 5 and of SVG within it.
YOUNGER = {"HTML_UNKNOWN_TAG"}


@pytest.mark.parametrize("which", ["mission_dir", "refused_dir"])
def test_a_validating_parser_finds_no_fault_in_the_page(which, request):
    folder = request.getfixturevalue(which)
    parser = lxml.etree.HTMLParser(huge_tree=True)
    lxml.etree.fromstring((folder / "report.html").read_bytes(), parser)
    assert [e for e in parser.error_log if e.type_name not in YOUNGER] == []


def test_every_picture_says_what_it_shows_and_no_name_is_given_twice(page, mission_dir):
    text = (mission_dir / "report.html").read_text()
    assert all('alt="' in tag for tag in re.findall(r"<img [^>]*>", text))
    for tag in re.findall(r"<svg [^>]*>", text):
        assert "aria-label=" in tag or "aria-hidden" in tag
    assert len(page.ids) == len(set(page.ids))


def test_what_is_told_after_the_flight_stands_in_the_head(mission_dir):
    told = {"pilot": "P. Ilot", "weather": "4 m/s, dry", "weather_source": "met mast"}
    told |= {"time_zone": "Europe/Berlin", "company": "Blades & Co"}
    page = Page(write_report(mission_dir, told=told))
    for words in ("P. Ilot", "4 m/s, dry (met mast)", "Blades & Co", "Europe/Berlin (UTC+01:00)"):
        assert words in page.words
    assert "11:14" in page.words  # 10:14 UTC


def test_a_logo_is_carried_inside_the_page(mission_dir, tmp_path):
    logo = tmp_path / "logo.png"
    cv2.imwrite(str(logo), np.zeros((8, 8, 3), np.uint8))
    text = write_report(mission_dir, told={"logo": str(logo)}).read_text()
    assert 'class="logo"' in text
    for bad in ("logo.exe", "missing.png"):
        with pytest.raises(BadLogo, match=bad):
            write_report(mission_dir, told={"logo": str(tmp_path / bad)})


def test_a_template_of_ones_own_replaces_a_part(mission_dir, tmp_path):
    (tmp_path / "_rotor.html.j2").write_text('<p id="rotor">ours: {{ mission.site }}</p>')
    page = Page(write_report(mission_dir, told={"templates": str(tmp_path)}))
    assert "ours: hill-3" in page.words
    (tmp_path / "_rotor.html.j2").write_text("{{ nonsense }}")
    with pytest.raises(BadTemplate, match="nonsense"):
        write_report(mission_dir, told={"templates": str(tmp_path)})


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
    assert "nothing of what was asked for was inspected" in page.words
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
