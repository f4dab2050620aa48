from drivers.simulated.setpoint_timing import SetpointTiming


def test_gaps_are_counted_in_offboard_alone():
    timing = SetpointTiming()
    for i in range(10):
        timing.arrived(i * 0.05, i * 25_000_000, offboard=False)
    assert timing.gaps()[0].count == 0
    for i in range(10, 31):
        timing.arrived(i * 0.05, i * 25_000_000, offboard=True)
    mission, wall = timing.gaps()
    assert (mission.count, mission.p50, wall.p50) == (20, 50.0, 25.0)


def test_leaving_offboard_is_no_gap_but_a_stall_is():
    timing = SetpointTiming()
    timing.arrived(1.0, 0, offboard=True)
    timing.arrived(2.0, 0, offboard=False)
    timing.arrived(9.0, 0, offboard=True)
    timing.arrived(12.0, 3_000_000_000, offboard=True)
    assert timing.gaps()[0].max == 3000.0
    assert timing.gaps()[0].count == 1
