"""Where requests arrive: each is checked, answered at once, and becomes at most one intent."""

from __future__ import annotations

import difflib
import logging
import time
from collections.abc import Callable
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from config.errors import first_fault
from config.presets import turbines_of
from config.settings import Settings
from drivers.bus import MAX_REQUEST_BYTES, Ask
from drivers.bus_access import ALL_VERBS, LOCAL, QUERIES, VERBS, Role
from mission.flight.command import MissionState
from mission.flight.observation import RequestKind
from mission.remote.history import History
from mission.remote.messages import (
    Code,
    EventMessage,
    Intent,
    Known,
    PlainRequest,
    Reply,
    ResumeRequest,
    StartRequest,
    StateMessage,
    TurbineInfo,
)
from mission.remote.started import Started
from mission.remote.unfinished import NotResumable, Unfinished, unfinished

log = logging.getLogger(__name__)

RUNNING = (MissionState.RUNNING, MissionState.PAUSED)
#: Requests of a running mission.
_OF_MISSION = tuple(
    RequestKind(verb) for verb in ALL_VERBS if verb not in (*QUERIES, RequestKind.START)
)
TOO_MANY = (
    Reply(ok=False, code=Code.TOO_MANY_REQUESTS, text="too many requests: wait a second")
    .model_dump_json()
    .encode()
)


class Desk:
    """Answers requests of one vehicle.

    ``hand_over`` takes each validated intent, ``tell`` each line for the event log.
    """

    def __init__(
        self,
        settings: Settings,
        history: History,
        hand_over: Callable[[Intent], None],
        tell: Callable[[EventMessage], None],
        roles: dict[str, Role],
        count: Callable[[str], None] = lambda _: None,
    ) -> None:
        """``count`` is told the code of every reply."""
        self._settings = settings
        self._history = history
        self._hand_over = hand_over
        self._tell = tell
        self._roles = roles
        self._count = count
        self._started = Started(Path(settings.missions_dir))
        self._pending: tuple[str, int] | None = None
        """Mission folder and flight that were handed over and not taken up yet."""
        self._resumed: dict[str, str] = {}
        self._turbines = tuple(_turbine_info(settings))
        self._handlers: dict[str, Callable[[Ask], Reply]] = {
            "start": self._start,
            "status": self._status,
            "turbines": self._list_turbines,
            "history": self._tell_history,
            **{kind: partial(self._plain, kind) for kind in _OF_MISSION},
            "resume": self._resume,
        }

    def answer(self, ask: Ask) -> bytes:
        """Return the reply to a request, whatever its bytes are."""
        reply = self._answer(ask)
        self._count(reply.code)
        if ask.verb not in QUERIES:
            self._audit(ask, reply)
        return reply.model_dump_json().encode()

    def take_state(self, state: StateMessage) -> None:
        """Hear how the mission stands: flight has taken over what it was handed."""
        if self._pending == (state.mission_dir, state.progress.flight):
            self._pending = None

    @property
    def under_way(self) -> bool:
        """Whether a mission was started and has not ended."""
        state = self._history.state
        running = state is not None and state.progress.state in RUNNING
        return self._pending is not None or running

    def forget_pending(self) -> None:
        """Flight is gone: what it was handed last is not flown."""
        self._pending = None

    def _answer(self, ask: Ask) -> Reply:
        if not self._allowed(ask):
            return _refuse(Code.NOT_ALLOWED, f"{ask.who} may not {ask.verb}")
        if len(ask.payload) > MAX_REQUEST_BYTES:
            return _refuse(Code.TOO_LARGE, f"a request is at most {MAX_REQUEST_BYTES} bytes")
        try:
            return self._handlers[ask.verb](ask)
        except ValidationError as error:
            return _refuse(Code.BAD_REQUEST, first_fault(error, whole="request"))
        except (ValueError, RecursionError) as error:
            return _refuse(Code.BAD_REQUEST, f"the request is not valid JSON: {error}")

    def _allowed(self, ask: Ask) -> bool:
        """Check the role once more: the router has checked it before."""
        role = Role.OPERATOR if ask.who == LOCAL else self._roles.get(ask.who)
        routed = Role.ROUTER in self._roles.values()
        if role is None and routed:
            return True  # let in by the site's router, which knows more names than we
        return role is not None and ask.verb in VERBS.get(role, ())

    def _audit(self, ask: Ask, reply: Reply) -> None:
        """Say who asked for what and what became of it; kept with the mission's events."""
        state = self._history.state
        outcome = "accepted" if reply.ok else f"refused ({reply.code})"
        text = f"{ask.who} asked to {ask.verb}: {outcome}"
        log.info("%s", text)
        self._tell(
            EventMessage(
                mission_s=0.0 if state is None else state.mission_s,
                name="request",
                severity="info",
                text=text,
            )
        )

    def _start(self, ask: Ask) -> Reply:
        request = StartRequest.model_validate_json(ask.payload)
        earlier = self._started.of(request.id)
        if earlier is not None:
            return _started_before(request, *earlier)
        refusal = self._refusal(request)
        if refusal is not None:
            return refusal
        inspection = self._settings.inspection
        blades = request.blades or inspection.blades
        sides = request.sides or inspection.sides
        if request.dry_run:
            words = f"would fly {', '.join(sides)} of {', '.join(blades)} at {request.site}"
            return Reply(ok=True, code=Code.WOULD_START, text=words, state=self._history.state)
        try:
            folder = self._new_folder(request.site)
            self._started.keep(request, folder)
        except OSError as error:
            return _refuse(Code.NO_FOLDER, f"the mission folder cannot be made: {error}")
        known = {name: getattr(request, name) for name in Known.model_fields}
        intent = Intent(
            kind=RequestKind.START,
            id=request.id,
            site=request.site,
            operator=request.operator,
            rotor_locked=request.rotor_locked,
            blades=blades,
            sides=sides,
            mission_dir=str(folder),
            airborne=request.airborne,
            rendezvous_w=request.rendezvous_w,
            **known,
        )
        self._pending = str(folder), 1
        self._history.begin()
        self._hand_over(intent)
        return Reply(ok=True, code=Code.STARTED, text="mission started", mission_dir=str(folder))

    def _refusal(self, request: StartRequest) -> Reply | None:
        """Return why this mission may not start now; None: it may."""
        if request.expires_utc_s is not None and time.time() > request.expires_utc_s:
            return _refuse(Code.EXPIRED, "the request expired before it arrived")
        names = [info.name for info in self._turbines]
        if request.site not in names:
            close = difflib.get_close_matches(request.site, names, n=1)
            meant = f"; did you mean {close[0]!r}?" if close else ""
            known = ", ".join(names) or "none is configured: add a [[sites]] table"
            return _refuse(
                Code.UNKNOWN_TURBINE, f"no turbine {request.site!r}{meant} (known: {known})"
            )
        if not request.rotor_locked:
            return _refuse(Code.NOT_CONFIRMED, "confirm that the rotor is locked and yaw is off")
        state = self._history.state
        if state is None:
            return _refuse(Code.NOT_READY, "flight is not ready yet: try again in a second")
        if self.under_way:
            return _refuse(Code.BUSY, "a mission is running: abort it or wait for its end")
        if not state.link_ok:
            return _refuse(Code.NO_VEHICLE, state.progress.words)
        return None

    def _new_folder(self, site: str) -> Path:
        stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
        root = Path(self._settings.missions_dir).resolve()
        folder, count = root / f"{stamp}-{site}", 1
        while folder.exists():
            count += 1
            folder = root / f"{stamp}-{site}-{count}"
        folder.mkdir(parents=True)
        return folder

    def _plain(self, kind: RequestKind, ask: Ask) -> Reply:
        request = PlainRequest.model_validate_json(ask.payload)
        state = self._history.state
        if state is None or not self.under_way:
            return _refuse(Code.NOT_RUNNING, f"no mission is running: nothing to {kind}")
        self._hand_over(Intent(kind=kind, id=request.id))
        return Reply(ok=True, code=Code.ACCEPTED, text=f"{kind} handed to flight", state=state)

    def _resume(self, ask: Ask) -> Reply:
        """Go on after a pause; where no mission runs, with one that ended unfinished."""
        request = ResumeRequest.model_validate_json(ask.payload)
        state = self._history.state
        if request.id in self._resumed:
            return _resumed_before(self._resumed[request.id])
        if self.under_way and not request.mission:
            self._hand_over(Intent(kind=RequestKind.RESUME, id=request.id))
            text = f"{RequestKind.RESUME} handed to flight"
            return Reply(ok=True, code=Code.ACCEPTED, text=text, state=state)
        try:
            found = unfinished(Path(self._settings.missions_dir).resolve(), request.mission)
        except NotResumable as error:
            named = request.mission or "no mission is running" not in str(error)
            return _refuse(Code.NOT_RESUMABLE if named else Code.NOT_RUNNING, str(error))
        if found.last is not None and found.last.intent.id == request.id:
            return _resumed_before(str(found.folder))
        return self._refused_again(request, found) or self._fly_on(request, found)

    def _refused_again(self, request: ResumeRequest, found: Unfinished) -> Reply | None:
        """Return why this mission may not go on now; None: it may."""
        name = found.folder.name
        if not request.operator or not request.rotor_locked:
            words = f"to go on with {name}, say who you are and that the rotor is still locked"
            return _refuse(Code.NOT_CONFIRMED, words)
        given = {"rotor_locked": True, "expires_utc_s": None}
        return self._refusal(found.request.model_copy(update=given))

    def _fly_on(self, request: ResumeRequest, found: Unfinished) -> Reply:
        first, inspection = found.request, self._settings.inspection
        words = f"flight {found.flight} of {found.folder.name}"
        if request.dry_run:
            return Reply(ok=True, code=Code.WOULD_START, text=f"would begin {words}")
        asked = found.asked
        intent = Intent(
            kind=RequestKind.START,
            id=request.id,
            site=first.site,
            operator=request.operator,
            rotor_locked=request.rotor_locked,
            blades=asked.blades if asked else first.blades or inspection.blades,
            sides=asked.sides if asked else first.sides or inspection.sides,
            mission_dir=str(found.folder),
            flight=found.flight,
            airborne=request.airborne,
            **{name: getattr(first, name) for name in Known.model_fields},
        )
        self._pending = str(found.folder), found.flight
        self._resumed[request.id] = str(found.folder)
        self._history.begin()
        self._hand_over(intent)
        return Reply(ok=True, code=Code.RESUMED, text=words, mission_dir=str(found.folder))

    def _status(self, ask: Ask) -> Reply:
        PlainRequest.model_validate_json(ask.payload)
        state = self._history.state
        if state is None:
            return Reply(ok=True, code=Code.STARTING, text="flight is not ready yet")
        words, folder = state.progress.words, state.mission_dir
        return Reply(ok=True, code=Code.OK, text=words, mission_dir=folder, state=state)

    def _list_turbines(self, ask: Ask) -> Reply:
        PlainRequest.model_validate_json(ask.payload)
        text = ", ".join(info.name for info in self._turbines) or "no turbine is configured"
        return Reply(ok=True, code=Code.OK, text=text, turbines=self._turbines)

    def _tell_history(self, ask: Ask) -> Reply:
        PlainRequest.model_validate_json(ask.payload)
        history = self._history
        return Reply(
            ok=True,
            code=Code.OK,
            text="" if history.state is None else history.state.progress.words,
            mission_dir="" if history.state is None else history.state.mission_dir,
            state=history.state,
            turbines=self._turbines,
            events=history.events,
            photos=history.photos,
            rotor=history.rotor,
        )


def _turbine_info(settings: Settings) -> list[TurbineInfo]:
    found = []
    turbines = turbines_of(settings.sites)
    for site in settings.sites:
        turbine = turbines[site.name]
        found.append(
            TurbineInfo(
                name=site.name,
                turbine=turbine.name,
                hub_height_m=turbine.hub_height_m,
                rotor_diameter_m=turbine.rotor_diameter_m,
                blade_length_m=turbine.blade_length_m,
                tower_enu_m=(site.tower_east_m, site.tower_north_m, site.tower_up_m),
            )
        )
    return found


def _started_before(request: StartRequest, first: StartRequest, folder: str) -> Reply:
    if request != first:
        return _refuse(Code.ID_REUSED, f"id {request.id!r} has started another mission before")
    return Reply(ok=True, code=Code.ALREADY_STARTED, text="started before", mission_dir=folder)


def _resumed_before(folder: str) -> Reply:
    return Reply(ok=True, code=Code.ALREADY_STARTED, text="resumed before", mission_dir=folder)


def _refuse(code: Code, text: str) -> Reply:
    return Reply(ok=False, code=code, text=text)
