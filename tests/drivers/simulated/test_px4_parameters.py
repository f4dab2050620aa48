import struct

from config.settings import Settings
from drivers.simulated.px4_parameters import INT32, REAL32, Parameters, parameters_for


def test_integers_travel_as_the_bytes_of_a_float():
    parameters = Parameters()
    wire = parameters.get("COM_OBL_RC_ACT").wire_value()
    assert struct.unpack("<i", struct.pack("<f", wire))[0] == 5
    assert parameters.set_from_wire("COM_OBL_RC_ACT", struct.unpack("<f", b"\3\0\0\0")[0], INT32)
    assert parameters["COM_OBL_RC_ACT"] == 3


def test_a_wrong_type_or_name_or_no_number_changes_nothing():
    parameters = Parameters()
    assert not parameters.set_from_wire("COM_OBL_RC_ACT", 3.0, REAL32)
    assert not parameters.set_from_wire("NO_SUCH", 3.0, REAL32)
    assert not parameters.set_from_wire("COM_OF_LOSS_T", float("nan"), REAL32)
    assert parameters["COM_OF_LOSS_T"] == 0.5
    assert parameters.get("NO_SUCH") is None


def test_every_parameter_is_found_by_its_index():
    parameters = Parameters()
    assert [parameters.at(i).name for i in range(len(parameters))] == list(parameters.names)
    assert parameters.at(len(parameters)) is None
    assert all(len(name) <= 16 for name in parameters.names)


def test_the_vehicle_is_set_up_for_its_turbine():
    parameters = parameters_for(Settings(), 140.0)
    assert parameters["RTL_RETURN_ALT"] == 140.0
    assert parameters["BAT_CRIT_THR"] == 0.15
