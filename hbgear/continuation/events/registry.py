"""Registry of events: the names under which `trace` locates them.

    trace(problem, "Omega", span, events=["PK"])              hbgear trace MODEL --event PK

Events that are on by default belong to a problem (`ContinuationProblem.events`): it locates them in every trace. The
others are located if their names are given. Users register their own with `register_event`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from hbgear.common.text.messages import quoted
from hbgear.continuation.events.detector import events_of
from hbgear.continuation.events.event import RESERVED, Event
from hbgear.continuation.problem.base import ContinuationProblem

_Event = TypeVar("_Event", bound=Event | type[Event])


def _always(problem: ContinuationProblem, parameter: str) -> bool:
    """Return True: the event can be located on all curves."""
    return True


@dataclass(frozen=True)
class RegisteredEvent:
    """Entry of the registry.

    ``create`` returns the event, ``default`` is True if a problem that has the event locates it in every trace,
    ``origin`` is the module that registered it, and ``applies`` returns whether it can be located on the curves of a
    problem in a parameter.
    """

    name: str
    create: Callable[[], Event]
    meaning: str
    default: bool
    origin: str
    applies: Callable[[ContinuationProblem, str], bool] = _always


EVENTS: dict[str, RegisteredEvent] = {}
"""Registered events by name."""


def register_event(event: _Event, /, *, name: str | None = None) -> _Event:
    """Register an event, which `trace` then locates if its name is given: a decorator of a class, or a call.

    Parameters
    ----------
    event : Event or type
        An `Event`, or a class derived from it whose constructor needs no arguments.
    name : str, optional
        Name in ``events=["name"]`` and in ``hbgear trace --event NAME``. Default: the kind of the event, which is the
        stem of the labels.

    Returns
    -------
    Event or type
        The event itself.

    Raises
    ------
    TypeError
        If it is no event, or the class needs arguments.
    ValueError
        If the name or the kind belongs to another event.

    Notes
    -----
    An event that is registered again by the same module, as in a notebook, replaces the first one.

    Examples
    --------
    >>> import hbgear as hb
    >>> limit = hb.Event("limit", lambda point: point.amplitude("max") - 1.3, "the largest deflection is 1.3")
    >>> limit = hb.continuation.register_event(limit)
    >>> curve = hb.trace(hb.HarmonicBalance(hb.SpurPair(), 8), "Omega", (1.2, 0.6), events=["limit"])
    >>> round(curve["limit1"].amplitude("max"), 9)
    1.3
    """
    create = _factory(event)
    created = create()
    if created.kind in RESERVED:
        raise ValueError(
            f"register_event: kind = {created.kind!r} is one that hbgear uses itself ({', '.join(RESERVED)}); "
            "choose another"
        )
    name = created.kind if name is None else name
    if not isinstance(name, str) or not name or name in RESERVED or any(c.isspace() or c == "," for c in name):
        raise ValueError(
            f"register_event: the name {quoted(name)} must be a word, and none of {', '.join(RESERVED)}; "
            "give another one: register_event(event, name=...)"
        )
    origin = _module_of(event)
    registered = EVENTS.get(name)
    if registered is not None and registered.origin != origin:
        raise ValueError(
            f"register_event: the name '{name}' belongs to an event of {registered.origin}; "
            "give another one: register_event(event, name=...)"
        )
    EVENTS[name] = RegisteredEvent(name, create, created.meaning, False, origin)
    return event


def _factory(event: Any) -> Callable[[], Event]:
    """Return the function without arguments that returns an event."""
    if isinstance(event, Event):
        return lambda: event
    if not (isinstance(event, type) and issubclass(event, Event)):
        raise TypeError(f"register_event needs an hb.Event or a class derived from it, got {quoted(event)}")
    needed = [
        parameter.name
        for parameter in inspect.signature(event).parameters.values()
        if parameter.default is parameter.empty
        and parameter.kind not in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD)
    ]
    if needed:
        raise TypeError(
            f"register_event: {event.__name__} needs {', '.join(needed)}; give the arguments defaults, or register "
            f"an object: register_event({event.__name__}(...))"
        )
    return event


def _module_of(event: Any) -> str:
    """Return the module of an event: of its class, or for an `Event` itself of its test."""
    source = event if isinstance(event, type) else type(event)
    return str(getattr(event.test_function, "__module__", "") if source is Event else source.__module__)


def optional_events() -> dict[str, RegisteredEvent]:
    """Return the registered events by name that are located if their names are given."""
    return {name: entry for name, entry in EVENTS.items() if not entry.default}


def event_of_kind(kind: str) -> Event | None:
    """Return the registered event of a kind, of a user or "PK", for special points from files, or None."""
    events = (
        entry.create() for entry in optional_events().values() if entry.name == kind or entry.name not in RESERVED
    )
    return next((event for event in events if event.kind == kind), None)


def resolved_events(events: Sequence[Event | str], problem: ContinuationProblem, parameter: str) -> tuple[Event, ...]:
    """Return events, with names replaced by the events of the problem and of the registry.

    ValueError is raised if no event has a name, or the event cannot be located on curves of the problem.
    """
    resolved = []
    standard = {event.kind: event for event in events_of(problem, parameter)}
    for event in events:
        if isinstance(event, Event):
            resolved.append(event)
        elif event in standard:
            resolved.append(standard[event])
        elif event in EVENTS and EVENTS[event].applies(problem, parameter):
            resolved.append(EVENTS[event].create())
        else:
            raise ValueError(_unknown(event, standard, problem, parameter))
    return tuple(resolved)


def _unknown(name: str, standard: dict[str, Event], problem: ContinuationProblem, parameter: str) -> str:
    """Return the message for an event that cannot be located, with the events that can."""
    usable = [key for key, entry in optional_events().items() if entry.applies(problem, parameter)]
    reason = "the event {} does not exist for this problem and parameter" if name in EVENTS else "no event {}"
    names = f"; on request: {', '.join(usable)}" if usable else ""
    return f"{reason.format(quoted(name))}; always located: {', '.join(standard)}{names}"
