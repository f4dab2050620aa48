"""A farm flown as a queue: a turbine for each free vehicle, until all are flown. Pure.

What has been done is a value that is written after every step, so that the queue goes on where it
stopped: the id of a start is chosen and kept before it is sent, and the same id never starts a
second mission.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Self

from pydantic import Field, ValidationError, model_validator

from config.errors import ConfigError, first_fault
from config.model import ConfigModel, Fraction
from mission.flight.command import TERMINAL, MissionState
from mission.remote.messages import StateMessage

#: A vehicle that tells of another mission so long after a start has lost ours.
FORGOTTEN_S = 30.0
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,64}$")]


class FarmVehicle(ConfigModel):
    """One vehicle and where it is reached."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
    router: str = ""
    """End point of its daemon; empty: the farm's."""


class FarmTurbine(ConfigModel):
    """One turbine of the queue, named as the vehicles' settings name it."""

    name: Name
    vehicles: tuple[str, ...] = ()
    """Which vehicles may fly it; empty: each that knows it."""
    rotor_locked: bool = False
    """The operator's word for this turbine: rotor braked and locked, yaw off."""


class Farm(ConfigModel):
    """A farm file."""

    operator: Annotated[str, Field(min_length=1, max_length=80)]
    router: str = "tcp/127.0.0.1:7447"
    """End point of the vehicles that name none of their own."""
    min_battery: Fraction = 0.8
    """A vehicle with less waits for a new battery."""
    tries: Annotated[int, Field(ge=1, le=10)] = 2
    """A turbine is flown at most so often until it is completed."""
    vehicles: Annotated[tuple[FarmVehicle, ...], Field(min_length=1)]
    turbines: Annotated[tuple[FarmTurbine, ...], Field(min_length=1)]

    @model_validator(mode="after")
    def _names_are_unique_and_known(self) -> Self:
        names = [vehicle.name for vehicle in self.vehicles]
        for kind, all_names in (("vehicle", names), ("turbine", [t.name for t in self.turbines])):
            twice = {name for name in all_names if all_names.count(name) > 1}
            if twice:
                raise ValueError(f"{kind} {min(twice)!r} is named twice")
        for turbine in self.turbines:
            unknown = sorted(set(turbine.vehicles) - set(names))
            if unknown:
                raise ValueError(f"turbine {turbine.name!r}: there is no vehicle {unknown[0]!r}")
        return self


def load_farm(path: Path) -> Farm:
    """Return a farm file's content. Raises `config.errors.ConfigError`."""
    try:
        table = tomllib.loads(path.read_text())
    except OSError as error:
        raise ConfigError(f"{path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: not valid TOML: {error}") from error
    try:
        return Farm.model_validate(table)
    except ValidationError as error:
        raise ConfigError(f"{path}: {first_fault(error)}") from error


class Stage(StrEnum):
    """How far a turbine is."""

    WAITING = "waiting"
    FLYING = "flying"
    COMPLETED = "completed"
    GIVEN_UP = "given_up"


class TurbineRecord(ConfigModel):
    """What became of a turbine so far."""

    stage: Stage = Stage.WAITING
    vehicle: str = ""
    request_id: str = ""
    mission_dir: str = ""
    started_utc_s: float = 0.0
    tries: int = 0
    words: str = ""
    """How the last try ended."""


class Ledger(ConfigModel):
    """What became of the whole farm so far; written after every step."""

    version: int = 1
    turbines: dict[str, TurbineRecord] = Field(default_factory=dict)

    def of(self, turbine: str) -> TurbineRecord:
        """Return a turbine's record."""
        return self.turbines.get(turbine, TurbineRecord())

    def with_record(self, turbine: str, **changes: object) -> Ledger:
        """Return the ledger with a turbine's record changed."""
        record = self.of(turbine).model_copy(update=changes)
        return self.model_copy(update={"turbines": self.turbines | {turbine: record}})


@dataclass(frozen=True, slots=True)
class VehicleView:
    """What is known of a vehicle now."""

    state: StateMessage
    turbines: frozenset[str]
    """Those that its settings know."""


@dataclass(frozen=True, slots=True)
class Start:
    """A turbine that a vehicle shall fly now."""

    turbine: str
    vehicle: str


def next_starts(farm: Farm, ledger: Ledger, views: Mapping[str, VehicleView]) -> tuple[Start, ...]:
    """Return who flies what next: the queue's order, each free vehicle at most one."""
    busy = {record.vehicle for record in ledger.turbines.values() if record.stage is Stage.FLYING}
    free = {name: view for name, view in views.items() if name not in busy and _free(farm, view)}
    starts = []
    for turbine in farm.turbines:
        if ledger.of(turbine.name).stage is not Stage.WAITING or not turbine.rotor_locked:
            continue
        for name, view in free.items():
            allowed = not turbine.vehicles or name in turbine.vehicles
            if allowed and turbine.name in view.turbines:
                starts.append(Start(turbine.name, name))
                del free[name]
                break
    return tuple(starts)


def after_states(
    farm: Farm, ledger: Ledger, views: Mapping[str, VehicleView], utc_s: float
) -> Ledger:
    """Return the ledger after what the vehicles say now of the missions that were flying."""
    for name, record in ledger.turbines.items():
        view = views.get(record.vehicle)
        if record.stage is not Stage.FLYING or view is None or not record.mission_dir:
            continue
        state, progress = view.state, view.state.progress
        if state.mission_dir == record.mission_dir:
            if progress.state in TERMINAL:
                ended = _ended(farm, record, progress.state, progress.words)
                ledger = ledger.with_record(name, **ended)
        elif utc_s - record.started_utc_s > FORGOTTEN_S:
            words = f"{record.vehicle} knows nothing of it any more"
            ended = _ended(farm, record, MissionState.FAILED, words)
            ledger = ledger.with_record(name, **ended)
    return ledger


def waits_for(farm: Farm, ledger: Ledger) -> tuple[str, ...]:
    """Return the turbines that wait for the operator's word."""
    return tuple(
        turbine.name
        for turbine in farm.turbines
        if not turbine.rotor_locked and ledger.of(turbine.name).stage is Stage.WAITING
    )


def is_over(farm: Farm, ledger: Ledger) -> bool:
    """Return whether nothing is left that could be flown."""
    open_stages = (Stage.WAITING, Stage.FLYING)
    waiting = set(waits_for(farm, ledger))
    return not any(
        ledger.of(turbine.name).stage in open_stages and turbine.name not in waiting
        for turbine in farm.turbines
    )


def _ended(farm: Farm, record: TurbineRecord, state: MissionState, words: str) -> dict[str, object]:
    if state is MissionState.COMPLETED:
        stage = Stage.COMPLETED
    else:
        stage = Stage.WAITING if record.tries < farm.tries else Stage.GIVEN_UP
    return {"stage": stage, "words": f"{state}: {words}", "request_id": ""}


def _free(farm: Farm, view: VehicleView) -> bool:
    state = view.state
    running = state.progress.state in (MissionState.RUNNING, MissionState.PAUSED)
    charged = state.battery is not None and state.battery >= farm.min_battery
    return state.link_ok and charged and not running
