"""Whatever bytes come, parsers raise nothing but what their callers take."""

import contextlib
import json

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.faults.fuzz_targets import TARGETS
from tests.faults.fuzzing import fuzz

TEXTS = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner),
    max_leaves=6,
)


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_no_bytes_whatever_raise_what_is_not_told(target):
    suppressed = [HealthCheck.too_slow, HealthCheck.data_too_large]

    @settings(max_examples=25, deadline=None, suppress_health_check=suppressed)
    @given(st.binary(max_size=300))
    def parse(data):
        with contextlib.suppress(*target.raises):
            target.parse(data)

    parse()


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_what_is_almost_right_raises_nothing_else_either(target):
    assert fuzz(target, inputs=60, seed=7).disturbed >= 60


@settings(max_examples=60, deadline=None)
@given(TEXTS)
def test_a_request_of_any_shape_is_answered(value):

    target = next(target for target in TARGETS if target.name == "requests")
    target.parse(json.dumps(value).encode())
