import json

from drivers.autopilot_announcer import Announcer, Health, Level, PhotoPlace
from drivers.autopilot_errors import LinkFailed


class WireOfPaper:
    system_id = 1

    def __init__(self):
        self.sent = []

    def send(self, name, fields, component_id=1):
        self.sent.append((name, json.loads(fields)))


def test_a_heartbeat_tells_the_state_of_an_onboard_controller():
    wire = WireOfPaper()
    Announcer(wire).heartbeat(Health.CRITICAL)
    ((name, fields),) = wire.sent
    assert name == "HEARTBEAT"
    assert (fields["type"], fields["system_status"]) == (18, 5)


def test_a_long_sentence_goes_in_chunks_that_belong_together():
    wire = WireOfPaper()
    announcer = Announcer(wire)
    announcer.say(Level.NOTICE, "short")
    announcer.say(Level.WARNING, "x" * 120)
    announcer.say(Level.WARNING, "y" * 60)
    short, *first, a, b = [fields for _, fields in wire.sent]
    assert (short["id"], short["chunk_seq"], short["text"]) == (0, 0, "short")
    assert [len(f["text"]) for f in first] == [50, 50, 20]
    assert [f["chunk_seq"] for f in first] == [0, 1, 2]
    assert len({f["id"] for f in first}) == 1
    assert a["id"] == b["id"] != first[0]["id"] != 0


def test_a_text_that_is_not_ascii_can_be_sent():
    wire = WireOfPaper()
    Announcer(wire).say(Level.INFO, "Höhe 12 m")
    assert wire.sent[0][1]["text"] == "H?he 12 m"


def test_a_photo_is_told_in_the_units_of_the_wire():
    wire = WireOfPaper()
    place = PhotoPlace(3, 2**32 + 5, 10, 47.1, -8.2, 500.25, 12.5, (1, 0, 0, 0), "u" * 300)
    Announcer(wire).photo(place)
    ((name, fields),) = wire.sent
    assert name == "CAMERA_IMAGE_CAPTURED"
    assert (fields["lat"], fields["lon"]) == (471000000, -82000000)
    assert (fields["alt"], fields["relative_alt"]) == (500250, 12500)
    assert fields["time_boot_ms"] == 5
    assert len(fields["file_url"]) == 204


def test_a_link_that_is_closed_ends_nothing():
    class Closed(WireOfPaper):
        def send(self, name, fields, component_id=1):
            raise LinkFailed("closed")

    Announcer(Closed()).heartbeat(Health.STANDBY)
