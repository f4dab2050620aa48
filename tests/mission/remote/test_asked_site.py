from config.settings import Settings
from config.turbine import Site
from mission.remote.asked_site import asked_settings, asked_site
from mission.remote.messages import Known

SITE = Site(
    name="one",
    turbine="v27",
    tower_east_m=1.0,
    tower_north_m=60.0,
    nacelle_yaw_deg=10.0,
    blade_serials={"A": "a", "B": "b"},
)


def test_nothing_told_changes_nothing():
    assert asked_site(SITE, Known()) == SITE


def test_what_is_told_today_stands_in_the_place_of_what_is_configured():
    known = Known(
        nacelle_yaw_deg=275.0,
        blade_pitch_deg=88.0,
        blade_serials={"B": "new"},
        launch_enu_m=(-20.0, -70.0, 1.5),
    )
    site = asked_site(SITE, known)
    assert (site.nacelle_yaw_deg, site.blade_pitch_deg) == (275.0, 88.0)
    assert site.blade_serials == {"A": "a", "B": "new"}
    assert (site.tower_east_m, site.tower_north_m, site.tower_up_m) == (20.0, 70.0, -1.5)


def test_the_other_sites_stay_as_they_are():
    other = SITE.model_copy(update={"name": "two"})
    settings = Settings(sites=(SITE, other))
    changed = asked_settings(settings, "two", Known(nacelle_yaw_deg=99.0))
    assert changed.sites[0] == SITE
    assert changed.sites[1].nacelle_yaw_deg == 99.0
