"""How the daemon lives on its computer."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from config.model import ConfigModel


class Service(ConfigModel):
    """Metrics and logs."""

    metrics_port: Annotated[int, Field(ge=0, le=65535)] = 9478
    """Port of 127.0.0.1 where Prometheus reads figures; 0: none."""
    logs: Literal["auto", "text", "json"] = "auto"
    """`auto`: JSON where they go to systemd's journal, readable lines elsewhere."""
