import hashlib
import json

import pytest

from mission.records.mission_file import read_mission
from mission.records.summary import add_truth


def test_the_figures_of_the_flight_stand_in_mission_json(mission_json):
    assert mission_json["schema"] == 1
    assert mission_json["state"] == "completed"
    assert mission_json["rotor"]["stop_angle_deg"] == 61.58
    assert mission_json["clearance_m"]["min"] == 8.9
    assert mission_json["coverage"] == pytest.approx(13.0 / 63.25)
    assert [one["side"] for one in mission_json["passes"]] == ["PS", "SS"]


def test_the_hub_is_measured_from_the_towers_foot(mission_json):
    assert mission_json["rotor"]["hub_m"] == pytest.approx([0.0, 4.0, 83.5])


def test_photos_are_counted_by_what_became_of_them(mission_json):
    assert mission_json["photos"] == {"kept": 4, "rejected": 1, "lost": 0}
    rejected = [photo for photo in mission_json["photo_list"] if not photo["kept"]]
    assert [photo["reason"] for photo in rejected] == ["the blade is too dark"]


def test_the_photographed_stretches_add_up_to_the_coverage(mission_json):
    for one in mission_json["passes"]:
        seen = sum(high - low for low, high in one["photographed_m"])
        assert one["coverage"] == pytest.approx(seen / one["length_m"])


def test_coverage_is_of_the_skin_where_the_flight_knows_it(skin_dir):
    front, back = json.loads((skin_dir / "mission.json").read_text())["passes"]
    assert front["coverage"] == pytest.approx(0.5)
    assert back["coverage_reachable"] == pytest.approx(0.5 * 33.25 / 30.0)


def test_coverage_of_the_reachable_leaves_out_what_no_view_shows(mission_json):
    back = mission_json["passes"][1]
    assert back["coverage_reachable"] == pytest.approx(6.5 / 30.0)
    assert back["unseen"][0]["reason"] == "less than the clearance to tower"


def test_every_photo_has_its_place_on_the_map(mission_dir):
    places = json.loads((mission_dir / "photos.geojson").read_text())
    assert len(places["features"]) == 5
    assert places["features"][0]["geometry"]["coordinates"] == [6.5, 54.0, 100.0]


def test_the_manifest_holds_the_sums_of_the_photos(mission_dir):
    lines = (mission_dir / "SHA256SUMS").read_text().splitlines()
    sums = {name: digest for digest, name in (line.split("  ", 1) for line in lines)}
    photos = sorted(mission_dir.glob("photos/A/*/*.jpg"))
    assert len(photos) == 5
    for photo in photos:
        name = str(photo.relative_to(mission_dir))
        assert sums[name] == hashlib.sha256(photo.read_bytes()).hexdigest()


def test_a_refused_mission_leaves_a_whole_folder(refused_dir):
    mission = json.loads((refused_dir / "mission.json").read_text())
    assert (mission["state"], mission["rotor"], mission["passes"]) == ("refused", None, [])
    assert mission["lost"] == ["photo 3 was never delivered"]
    assert (refused_dir / "report.html").exists()


def test_what_is_written_can_be_read_again(mission_dir, mission_json, truth):
    add_truth(mission_dir, truth)
    mission = read_mission(mission_dir)
    assert mission.duration_s == mission_json["duration_s"]
    assert mission.begin_s == 5.0
    assert mission.truth is not None
    assert mission.truth.coverage["A"]["SS"] == 0.21


def test_truth_is_kept_apart_from_what_was_measured(mission_dir, mission_json, truth):
    judged = add_truth(mission_dir, truth)
    assert judged == json.loads((mission_dir / "mission.json").read_text())
    assert judged["rotor"] == mission_json["rotor"]
    assert judged["simulated"] is True
    assert judged["truth"]["min_clearance_m"] == 8.61


def test_errors_are_measured_less_true(mission_dir, truth):
    errors = add_truth(mission_dir, truth)["errors"]
    assert errors["stop_angle_deg"] == pytest.approx(0.18)
    assert errors["hub_m"] == pytest.approx(0.3)
    assert errors["normal_deg"] == pytest.approx(0.0)
    # No pitch was measured of C.
    assert errors["pitch_deg"] == pytest.approx({"A": -0.5, "B": 0.5})


def test_the_stop_angles_error_goes_the_short_way_round(mission_dir, truth):
    errors = add_truth(mission_dir, truth | {"stop_angle_deg": 61.58 + 119.9 - 120})["errors"]
    assert errors["stop_angle_deg"] == pytest.approx(0.1)


def test_setpoint_gaps_are_the_ones_measured_at_the_autopilot(mission_dir, truth):
    judged = add_truth(mission_dir, truth)
    assert judged["timing"]["setpoint_gap_ms"]["p99"] == 63.0
    assert judged["timing"]["tick_gap_ms"]["p99"] == 61.0
    assert "timing" not in judged["truth"]


def test_truth_without_a_measured_rotor_has_no_errors(refused_dir, truth):
    assert add_truth(refused_dir, truth)["errors"] == {}
