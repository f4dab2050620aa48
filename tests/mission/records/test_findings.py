import json

import pytest

from mission.records.findings import BadFindings, read_findings
from mission.records.mission_file import read_mission
from mission.records.report import write_report
from mission.records.report_blade_map import side_maps

CSV = """type,severity,blade,side,metre,chord,size_mm,text,photo
Erosion,3,A,PS,11.4,0.03,420,over 2 m,
Dirt,1,A,SS,3,,,,
Lightning mark,5,A,PS,4.9,0.2,40,"blackened, at the receptor",
"""


def written(tmp_path, text, name="findings.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_findings_are_read_worst_first_and_numbered(mission_dir, tmp_path):
    found = read_findings(written(tmp_path, CSV), mission_dir)
    assert [(one.number, one.kind, one.severity) for one in found] == [
        (1, "Lightning mark", 5),
        (2, "Erosion", 3),
        (3, "Dirt", 1),
    ]
    assert found[0].text == "blackened, at the receptor"
    assert found[2].size_mm is None


def test_the_report_draws_them_at_their_metre_and_lists_them(mission_dir, tmp_path):
    found = read_findings(written(tmp_path, CSV), mission_dir)
    text = write_report(mission_dir, found).read_text()
    assert f'class="finding s5"><circle cx="{1000 * 4.9 / 33.25:.1f}"' in text
    assert '<a href="#findings">' in text
    assert "Lightning mark" in text
    assert "420 mm" in text
    assert 'id="findings"' not in write_report(mission_dir).read_text()


def test_a_finding_is_drawn_where_it_lies_on_the_chord(mission_dir, tmp_path):
    text = (
        CSV.splitlines()[0] + "\nCrack,3,A,PS,10,0,,,\nCrack,3,A,PS,10,1,,,\nCrack,3,A,PS,10,,,,\n"
    )
    mission = read_mission(mission_dir)
    (side,) = (
        one
        for one in side_maps(mission, findings=read_findings(written(tmp_path, text), mission_dir))
        if one.findings
    )
    leading, trailing, unknown = (dot.y for dot in side.findings)
    outline = [tuple(map(float, one.split(","))) for one in side.outline.split()]
    near = sorted(y for x, y in outline if abs(x - 1000 * 10 / 33.25) < 12)
    assert (leading, trailing) == pytest.approx((near[0], near[-1]), abs=0.5)
    assert unknown == pytest.approx((leading + trailing) / 2)


def test_a_finding_names_its_photo_by_path_or_by_name(mission_dir, tmp_path):
    photo = next(mission_dir.glob("photos/A/PS/*.jpg"))
    for name in (photo.name, str(photo.relative_to(mission_dir))):
        text = CSV.replace("over 2 m,", f"over 2 m,{name}")
        (found,) = [
            f for f in read_findings(written(tmp_path, text), mission_dir) if f.kind == "Erosion"
        ]
        assert mission_dir / found.photo == photo


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("Crack,6,A,PS,3,,,,", "line 2: severity"),
        ("Crack,3,D,PS,3,,,,", "line 2: blade"),
        ("Crack,3,A,,3,,,,", "say where it is"),
        ("Crack,3,A,PS,3,1.2,,,", "chord"),
        ("Crack,3,A,PS,3,,,,../../etc/passwd", "no photo"),
        (",3,A,PS,3,,,,", "type"),
    ],
)
def test_a_line_that_cannot_be_used_is_named(mission_dir, tmp_path, line, words):
    path = written(tmp_path, CSV.splitlines()[0] + "\n" + line + "\n")
    with pytest.raises(BadFindings, match=words) as caught:
        read_findings(path, mission_dir)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("f.csv", "", "no findings"),
        ("f.json", "{", "not JSON"),
        ("f.json", "{}", "not COCO: images"),
        ("missing.csv", None, "cannot be read"),
    ],
)
def test_a_file_that_is_no_list_of_findings_is_refused(mission_dir, tmp_path, name, text, words):
    path = tmp_path / name
    if text is not None:
        path.write_text(text)
    with pytest.raises(BadFindings, match=words):
        read_findings(path, mission_dir)


def test_a_box_of_coco_on_a_photo_that_knows_no_blade_is_refused_in_words(mission_dir, tmp_path):
    photo = next(mission_dir.glob("photos/A/PS/*.jpg"))
    coco = {
        "images": [{"id": 4, "file_name": photo.name, "width": 648}],
        "annotations": [{"image_id": 4, "category_id": 2, "bbox": [300, 200, 40, 20]}],
        "categories": [{"id": 2, "name": "crack"}],
    }
    with pytest.raises(BadFindings, match=r"annotation 1: .*where the blade is"):
        read_findings(written(tmp_path, json.dumps(coco), "f.json"), mission_dir)
    coco["annotations"][0]["image_id"] = 9
    with pytest.raises(BadFindings, match="there is no image 9"):
        read_findings(written(tmp_path, json.dumps(coco), "f.json"), mission_dir)
