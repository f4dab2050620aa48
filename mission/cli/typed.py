"""What is typed after options of several parts, read; a mistake ends with one sentence."""

from __future__ import annotations

from mission.cli.exits import Exit, end


def blades_typed(text: str) -> tuple[tuple[str, ...] | None, dict[str, str]]:
    """Return the blades to fly and their serials from ``A,C`` or ``A=LM-1,B=LM-2,C=LM-3``.

    No text: None (as configured). Where serials are given, all blades of the configuration are
    flown: a serial names a blade, it does not choose it.
    """
    if not text:
        return None, {}
    names: list[str] = []
    serials: dict[str, str] = {}
    for part in text.split(","):
        name, equals, serial = part.strip().partition("=")
        if equals:
            serials[name] = serial
        else:
            names.append(name)
    if names and serials:
        end(Exit.CONFIGURATION, f"--blades {text!r}: either names, or a serial for each")
    return (tuple(names) or None), serials


def numbers_typed(option: str, text: str, count: int) -> tuple[float, ...] | None:
    """Return numbers written with commas between, the last ones 0 where left out; None: no text."""
    if not text:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        end(Exit.CONFIGURATION, f"{option} {text!r}: write numbers with commas between")
    if not count - 1 <= len(numbers) <= count:
        end(Exit.CONFIGURATION, f"{option} {text!r}: {count - 1} or {count} numbers are wanted")
    return tuple([*numbers, 0.0][:count])
