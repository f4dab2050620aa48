import json
import re
import shutil

import pytest

from mission.records.comparison import NotComparable, write_comparison


def with_serials(folder, serials, **changes):
    path = folder / "mission.json"
    mission = json.loads(path.read_text())
    mission["inspection"]["blade_serials"] = serials
    path.write_text(json.dumps(mission | changes))
    return folder


@pytest.fixture
def older_dir(mission_dir, tmp_path):
    """An earlier visit; the rotor stood otherwise, so the blade was called C."""
    folder = tmp_path / "older"
    shutil.copytree(mission_dir, folder)
    path = folder / "mission.json"
    mission = json.loads(path.read_text())
    for one in (*mission["passes"], *mission["photo_list"]):
        one["blade"] = "C"
    path.write_text(json.dumps(mission))
    return with_serials(folder, {"C": "LM-1"}, started_utc="2024-03-01T10:14:00+00:00")


def test_the_same_blade_stands_beside_itself_whatever_it_was_called(mission_dir, older_dir):
    with_serials(mission_dir, {"A": "LM-1", "B": "LM-7"})
    text = write_comparison(mission_dir, older_dir).read_text()
    assert "LM-1 PS" in text
    assert "LM-7" not in text
    assert "1 March 2024" in text
    assert "1 March 2026" in text
    # Two kept photos of each side, each beside that of the other visit.
    assert text.count("<img ") == 8
    links = re.findall(r'<a href="([^"#]+\.jpg)"', text)
    assert all((mission_dir / link).resolve().is_file() for link in links)


def test_a_place_without_a_photo_is_said_to_have_none(mission_dir, older_dir):
    with_serials(mission_dir, {"A": "LM-1"})
    path = older_dir / "mission.json"
    mission = json.loads(path.read_text())
    first = next(p for p in mission["photo_list"] if p["kept"])
    first["metre"] += 3.0
    path.write_text(json.dumps(mission))
    text = write_comparison(mission_dir, older_dir).read_text()
    assert text.count("no photo within 1.5 m") == 2


@pytest.mark.parametrize(
    ("serials", "words"),
    [
        ({}, "newer mission does not say which blades"),
        ({"A": "LM-9"}, "different blades: LM-9 and LM-1"),
    ],
)
def test_visits_to_other_blades_are_not_compared(mission_dir, older_dir, serials, words):
    with_serials(mission_dir, serials)
    with pytest.raises(NotComparable, match=words):
        write_comparison(mission_dir, older_dir)
    assert not (mission_dir / "comparison.html").exists()
