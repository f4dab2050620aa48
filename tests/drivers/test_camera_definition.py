import pytest

from drivers.camera_definition import MAX_BYTES, parse_definition

TEXT = b"""<?xml version="1.0" encoding="UTF-8" ?>
<mavlinkcamera>
  <definition version="7"><model>T20</model><vendor>X</vendor></definition>
  <parameters>
    <parameter name="CAM_EV" type="float" default="0">
      <options>
        <option name="0" value="0"/><option name="-0.7" value="-0.7"/>
        <option name="+0.3" value="0.3"/><option name="broken" value="x"/>
      </options>
    </parameter>
    <parameter name="CAM_ISO" type="uint32" min="100" max="1600" step="100"/>
  </parameters>
</mavlinkcamera>
"""


def test_lists_and_limits_are_read():
    found = parse_definition(TEXT)
    assert found["CAM_EV"].options == (-0.7, 0.0, 0.3)
    iso = found["CAM_ISO"]
    assert (iso.least, iso.most, iso.step, iso.options) == (100.0, 1600.0, 100.0, ())


@pytest.mark.parametrize(
    "text",
    [
        b"",
        b"not xml",
        b"<html></html>",
        b"<mavlinkcamera>",
        TEXT.replace(b"<mavlinkcamera>", b'<!DOCTYPE a [<!ENTITY b "c">]><mavlinkcamera>'),
        TEXT + b" " * MAX_BYTES,
        b"\xff\xfe\x00",
    ],
)
def test_what_is_no_definition_is_none(text):
    assert parse_definition(text) is None


def test_numbers_that_are_none_are_left_out():
    text = TEXT.replace(b'min="100"', b'min="nan"').replace(b'max="1600"', b'max="inf"')
    iso = parse_definition(text)["CAM_ISO"]
    assert (iso.least, iso.most) == (None, None)
