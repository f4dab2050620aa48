"""The page in a real browser: what is read, how large, and that its buttons reach the vehicle."""

import time

import cv2
import numpy as np
import pytest

from drivers.bus import Key
from drivers.codecs import encode_frame
from mission.flight.command import MissionState, Phase
from mission.remote.messages import MeteringMessage
from perception.values import Frame

from .chromium import PATH, Page
from .conftest import wait_until

pytestmark = pytest.mark.skipif(PATH is None, reason="needs chromium")
FIGURES = ("phase", "clearance", "battery", "angle", "age")
READ_PX = 36
REDRAWS_IN_2_S = """new Promise((done) => {
  let count = 0;
  const watch = new MutationObserver(() => { count += 1; });
  watch.observe(document.getElementById("rotor"), { childList: true });
  setTimeout(() => { watch.disconnect(); done(count); }, 2000);
})"""


def text(page, element):
    return page.value(f"document.getElementById('{element}').textContent")


@pytest.fixture
def heron_page(heron, serve, tmp_path):
    board, server = serve(heron)
    wait_until(lambda: board.history("heron") is not None)
    with Page(tmp_path / "chromium") as page:
        page.open(server.url)
        page.wait_for("document.getElementById('angle')?.textContent === '61.4'", 60)
        yield page


def test_figures_are_read_at_arms_length_and_follow_the_vehicle(heron_page, heron):
    page = heron_page
    assert text(page, "clearance") == "10.4"
    assert text(page, "battery") == "71"
    assert text(page, "phase") == "track"
    assert float(text(page, "age")) < 5
    for name in FIGURES:
        size = page.value(
            f"parseFloat(getComputedStyle(document.getElementById('{name}')).fontSize)"
        )
        assert size >= READ_PX, name
    heron.progress["heron"] = {"clearance_m": 7.4, "phase": Phase.RETURN}
    page.wait_for("document.getElementById('clearance').textContent === '7.4'")
    page.wait_for(
        "document.getElementById('clearance').closest('.figure').classList.contains('bad')"
    )


def test_the_coverage_of_a_side_grows_with_its_photos(heron_page, heron):
    page = heron_page
    page.wait_for("document.querySelector('#side-A-PS .share').textContent.includes('%')")
    before = page.value("parseFloat(document.querySelector('#side-A-PS .share').textContent)")
    assert before == pytest.approx(100 * 6.6 / 33.25, abs=2)  # two photos that overlap
    heron.vehicles["heron"].photo(3, "A", "PS", 20.0, True)
    heron.progress["heron"] = {"photos": 4}
    grown = f"parseFloat(document.querySelector('#side-A-PS .share').textContent) > {before + 5}"
    page.wait_for(grown)


def test_where_the_exposure_was_metered_is_drawn_over_the_picture(heron_page, heron):
    page, bus = heron_page, heron.vehicles["heron"].bus
    payload, _ = encode_frame(Frame(1.0, 1, np.full((360, 640), 90, np.uint8)))
    outline = ((0.4, 0.0), (0.6, 0.0), (0.6, 0.56), (0.4, 0.56))
    shown = MeteringMessage(
        stamp_s=1.0, aspect=0.5625, centre=(0.5, 0.28), radius=0.2, outline=outline
    )

    def drawn():
        bus.publish(Key.FRAME, payload)
        bus.publish(Key.METERING, shown.model_dump_json().encode())
        return page.value("document.querySelector('#metering polygon') !== null")

    wait_until(drawn)
    box = "document.querySelector('#metering polygon').getBBox()"
    assert page.value(f"[{box}.x, {box}.width]") == pytest.approx([400, 200])
    assert page.value("document.getElementById('metering').getAttribute('viewBox')") == (
        "0 0 1000 562.5"
    )


def test_words_of_the_vehicle_are_text_and_never_markup(heron_page):
    heron_page.wait_for("document.getElementById('events').textContent.includes('<b>bold</b>')")


def test_abort_takes_two_taps_and_reaches_the_vehicle_at_once(heron_page, heron):
    page, intents = heron_page, heron.vehicles["heron"].intents
    tap = "document.getElementById('abort').click()"
    page.value(tap)
    assert "Abort now?" in text(page, "abort")
    time.sleep(0.3)
    assert intents == []
    took_s = []
    for number in range(1, 4):
        begun = time.monotonic()
        page.value(tap)
        wait_until(lambda number=number: len(intents) == number)
        took_s.append(intents[-1][0] - begun)
        page.value(tap)
    assert intents[0][1].kind == "abort"
    # The machine that tests has other work, too: the quickest of three is ours.
    assert min(took_s) <= 0.3


def test_a_mission_is_started_only_with_the_operators_word(heron_page, heron):
    page = heron_page
    assert page.value("document.getElementById('start').disabled")
    heron.progress["heron"] = {"state": MissionState.IDLE, "phase": Phase.IDLE}
    page.wait_for("!document.getElementById('start').disabled")
    page.value("document.getElementById('start').click()")
    page.value("document.getElementById('operator').value = 'Ada'")
    page.value("document.getElementById('go').click()")
    page.wait_for("document.getElementById('start-reply').textContent.includes('locked')")
    page.value("document.getElementById('locked').click()")
    page.value("document.getElementById('check').click()")
    page.wait_for("document.getElementById('start-reply').textContent.includes('would fly')")
    assert heron.vehicles["heron"].intents == []
    page.value("document.getElementById('go').click()")
    wait_until(lambda: heron.vehicles["heron"].intents)
    intent = heron.vehicles["heron"].intents[0][1]
    assert (intent.kind, intent.site, intent.operator) == ("start", "hill-3", "Ada")


@pytest.mark.parametrize("size", [(1280, 800), (1024, 768)])
def test_all_of_it_fits_a_tablet_without_scrolling(fleet, serve, tmp_path, size):
    five = fleet("heron", "stork", "crane", "egret", "ibis")
    _, server = serve(five)
    with Page(tmp_path / "chromium", *size) as page:
        page.open(server.url + "#heron")
        page.wait_for("document.getElementById('angle')?.textContent === '61.4'", 60)
        for name in (*FIGURES, "rotor", "map", "traces", "sides", "abort", "start", "photos"):
            box = page.value(
                f"(r => [r.left, r.top, r.right, r.bottom])"
                f"(document.getElementById('{name}').getBoundingClientRect())"
            )
            assert box[0] >= 0, name
            assert box[1] >= 0, name
            assert box[2] <= size[0], name
            assert box[3] <= size[1], name
        assert page.value("document.querySelectorAll('#vehicles button').length") == 5
        # Twenty come in that time; the machine that tests has other work, too.
        assert page.value(REDRAWS_IN_2_S) >= 6
        picture = cv2.imdecode(np.frombuffer(page.picture(), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == size[::-1]
    assert picture.std() > 20


def test_old_data_is_told_by_its_age(heron_page, heron):
    heron.close()
    heron_page.wait_for("document.getElementById('vehicle').classList.contains('stale')", 30)
    assert float(text(heron_page, "age")) >= 3
