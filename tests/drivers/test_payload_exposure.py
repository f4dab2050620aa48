"""Cameras that differ, played by their parameters alone."""

import asyncio

import pytest

from drivers import payload_exposure
from drivers.autopilot_errors import Refused
from drivers.camera_definition import ParameterValues
from drivers.exposure_table import table_of_evs, table_of_pairs, table_that_fits
from drivers.payload_exposure import ExposureControl


class Camera:
    """Parameters of one camera, in the place of those on the wire."""

    def __init__(self, values, options=None, refuses=()):
        self.values = dict(values)
        self.options = options or {}
        self.refuses = refuses
        self.set_in_order = []

    def __call__(self, wire, component_id, *, extended):
        return self

    async def read(self, names):
        return {name: self.values[name] for name in names if name in self.values}

    async def set(self, name, value):
        if name in self.refuses or name not in self.values:
            raise Refused(f"parameter {name}: refused")
        choices = self.options.get(name, (value,))
        self.values[name] = min(choices, key=lambda one: abs(one - value))
        self.set_in_order.append(name)


class Clock:
    def now_s(self):
        return 5.0


async def told(monkeypatch, camera, wish=None, definition=None, shutter_s=1 / 2000):
    """Return the control after it learned the camera and applied a wish."""
    monkeypatch.setattr(payload_exposure, "Parameters", camera)
    monkeypatch.setattr(payload_exposure, "_LOOK_S", 0.01)

    async def read():
        return definition

    control = ExposureControl(None, 100, Clock(), lambda: True, 1 / 3, shutter_s, read)
    running = asyncio.create_task(control.run())
    for _ in range(1000):
        if control.known:
            break
        await asyncio.sleep(0.005)
    assert control.known
    if wish is not None:
        control.want(wish)
        await asyncio.sleep(0.1)
    running.cancel()
    with pytest.raises(asyncio.CancelledError):
        await running
    return control


async def test_a_list_of_evs_in_the_definition_file_is_what_is_asked_for(monkeypatch):
    evs = (-2.0, -1.3, -0.7, 0.0, 0.7, 1.3, 2.0)
    camera = Camera({"CAM_EV": 0.0, "CAM_EXPMODE": 1.0}, {"CAM_EV": evs})
    control = await told(monkeypatch, camera, 0.6, {"CAM_EV": ParameterValues(evs)})
    assert control.ev == 0.7
    assert (control.min_ev, control.max_ev) == (-2.0, 2.0)
    assert control.step_ev == pytest.approx(0.65, abs=0.1)
    assert control.snap(9.0) == 2.0
    assert control.evs == evs


async def test_limits_of_the_file_stand_in_where_the_camera_names_none(monkeypatch):
    told_values = ParameterValues(least=-2.0, most=2.0, step=0.5)
    control = await told(monkeypatch, Camera({"CAM_EV": 0.0}), 0.7, {"CAM_EV": told_values})
    assert (control.min_ev, control.max_ev, control.step_ev) == (-2.0, 2.0, 0.5)
    assert control.evs == ()
    assert control.ev == 0.5


async def test_a_camera_without_a_file_is_asked_by_its_parameters(monkeypatch):
    values = {"CAM_EV": 0.0, "CAM_EV_MIN": -1.0, "CAM_EV_MAX": 1.0, "CAM_EV_STEP": 0.5}
    control = await told(monkeypatch, Camera(values), 3.0)
    assert (control.ev, control.max_ev) == (1.0, 1.0)


class Late(Camera):
    """Does what it is told; its answers come too late."""

    async def set(self, name, value):
        await super().set(name, value)
        raise Refused(f"parameter {name}: timeout")


async def test_a_camera_that_answers_too_late_is_believed_by_what_it_is_set_to(monkeypatch):
    control = await told(monkeypatch, Late({"CAM_EV": 0.0, "CAM_EXPMODE": 1.0}), 2 / 3)
    assert control.ev == pytest.approx(2 / 3)
    assert control.ev_stamp_s == 5.0
    assert control.refusals == 0


async def test_a_camera_that_refuses_keeps_its_exposure_and_says_so(monkeypatch):
    camera = Camera({"CAM_EV": 0.0}, refuses=("CAM_EV",))
    control = await told(monkeypatch, camera, 2 / 3)
    assert control.ev == 0.0
    assert control.refusals > 0


async def test_a_camera_that_tells_nothing_and_rounds_shows_its_steps(monkeypatch):
    halves = tuple(k / 2 for k in range(-6, 7))
    camera = Camera({"CAM_EV": 0.0}, {"CAM_EV": halves})
    control = await told(monkeypatch, camera, 1 / 3)
    assert control.ev == 0.5
    assert control.evs == halves
    assert control.step_ev == 0.5
    assert control.snap(0.8) == 1.0


async def test_thirds_told_in_tenths_are_known_after_the_first_that_was_rounded(monkeypatch):
    tenths = tuple(round(k / 3, 1) for k in range(-9, 10))
    control = await told(monkeypatch, Camera({"CAM_EV": 0.0}, {"CAM_EV": tenths}), 2 / 3)
    assert control.ev == 0.7
    assert control.evs == tenths


@pytest.mark.parametrize(
    ("answers", "evs"),
    [
        ({1 / 3: 0.5, 0.5: 0.5}, (-1.0, -0.5, 0.0, 0.5, 1.0)),
        ({2 / 3: 1.0, 0.5: 1.0}, (-1.0, 0.0, 1.0)),
        ({1 / 3: 0.41}, None),
    ],
)
def test_the_finest_usual_steps_that_explain_a_camera_are_taken(answers, evs):
    table = table_that_fits("CAM_EV", answers, (-1.0, 1.0))
    assert (None if table is None else tuple(one.ev for one in table.exposures)) == evs


async def test_a_camera_without_ev_is_exposed_by_shutter_and_iso(monkeypatch):
    options = {
        "CAM_SHUTTERSPD": (1 / 8000, 1 / 4000, 1 / 2000, 1 / 1000),
        "CAM_ISO": (100.0, 200.0, 400.0, 800.0),
    }
    values = {"CAM_SHUTTERSPD": 1 / 2000, "CAM_ISO": 100.0, "CAM_EXPMODE": 0.0}
    camera = Camera(values, options)
    definition = {name: ParameterValues(tuple(found)) for name, found in options.items()}
    control = await told(monkeypatch, camera, 2.0, definition)
    assert control.manual
    assert control.ev == pytest.approx(2.0)
    # Longer than the flight wishes only where no ISO makes it.
    assert camera.values["CAM_SHUTTERSPD"] == 1 / 2000
    assert camera.values["CAM_ISO"] == 400.0
    assert control.shutter_s == 1 / 2000
    assert control.max_ev == pytest.approx(4.0)


async def test_a_camera_that_refuses_manual_and_has_no_ev_plainly_cannot(monkeypatch):
    values = {"CAM_SHUTTERSPD": 1 / 2000, "CAM_ISO": 100.0, "CAM_EXPMODE": 0.0}
    control = await told(monkeypatch, Camera(values, refuses=("CAM_EXPMODE",)), 1.0)
    assert control.ev is None
    assert not control.manual


async def test_a_camera_without_any_of_it_has_no_control(monkeypatch):
    control = await told(monkeypatch, Camera({}), 1.0)
    assert control.ev is None


def test_of_pairs_alike_the_one_with_less_gain_is_taken_and_too_long_a_shutter_last():
    table = table_of_pairs(
        ("S", (1 / 4000, 1 / 2000, 1 / 1000)), ("I", (100.0, 200.0)), (1 / 2000, 100.0), 1 / 2000
    )
    made = {round(one.ev): dict(one.parameters) for one in table.exposures}
    assert made[0] == {"S": 1 / 2000, "I": 100.0}
    assert made[1] == {"S": 1 / 2000, "I": 200.0}
    assert made[2] == {"S": 1 / 1000, "I": 200.0}


def test_a_table_knows_its_ends_and_its_usual_step():
    table = table_of_evs("CAM_EV", (1.0, -1.0, 0.0, 0.5, -0.5, 0.5))
    assert (table.min_ev, table.max_ev, table.step_ev) == (-1.0, 1.0, 0.5)
