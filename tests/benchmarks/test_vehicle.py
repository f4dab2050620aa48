from benchmarks.vehicle import measure


def test_the_simulated_vehicle_flies_about_as_px4_was_measured():
    rows = {row.name: row for row in measure(seed=3)}
    assert len(rows) == 7
    for row in rows.values():
        least, _, most = row.px4.partition("-")
        if least and "40 m: overshoot" not in row.name and "GNSS" not in row.name:
            assert 0.7 * float(least) < row.value < 1.3 * float(most or least), row.name
    assert rows["hover with GNSS: wander within a minute, half"].value > 0.6
