"""The site as it stands today: what is configured, and what the operator told with the request."""

from __future__ import annotations

from config.settings import Settings
from config.turbine import Site
from mission.remote.messages import Known


def asked_site(site: Site, known: Known) -> Site:
    """Return a site with what the operator knows in the place of what is configured."""
    told: dict[str, object] = {}
    if known.nacelle_yaw_deg is not None:
        told["nacelle_yaw_deg"] = known.nacelle_yaw_deg
    if known.blade_pitch_deg is not None:
        told["blade_pitch_deg"] = known.blade_pitch_deg
    if known.blade_serials:
        told["blade_serials"] = {**site.blade_serials, **known.blade_serials}
    if known.launch_enu_m is not None:
        east, north, up = known.launch_enu_m
        told |= {"tower_east_m": -east, "tower_north_m": -north, "tower_up_m": -up}
    return site.model_copy(update=told)


def asked_settings(settings: Settings, name: str, known: Known) -> Settings:
    """Return the settings with one site as the operator told it."""
    sites = tuple(asked_site(site, known) if site.name == name else site for site in settings.sites)
    return settings.model_copy(update={"sites": sites})
