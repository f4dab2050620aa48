"""What a newcomer reads first: which commands belong together, and examples of each."""

from __future__ import annotations

from collections.abc import Mapping

import typer

#: Title of a group, its commands, and what may be typed; a test types every line.
GROUPS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "Fly here, in simulation": {
        "simulate": (
            "bladescout simulate",
            "bladescout simulate full --seed 4 --out missions",
            "bladescout simulate quick faults/lidar-stops --junit missions.xml",
            "bladescout simulate mine.toml --set simulation.wind.mean_mps=7 --json",
        ),
        "field": ("bladescout field demo --speed 1",),
    },
    "On the drone": {
        "serve": (
            "bladescout serve --config drone.toml",
            "bladescout serve --config drone.toml --set guard.max_height_m=150",
        ),
        "install-service": (
            "bladescout install-service --config drone.toml --dry-run",
            "sudo .venv/bin/bladescout install-service --config drone.toml",
        ),
        "config": (),
    },
    "From the ground": {
        "turbines": ("bladescout turbines",),
        "start": (
            "bladescout start hill-3 --operator 'A. Person' --rotor-locked --dry-run",
            "bladescout start hill-3 --operator 'A. Person' --rotor-locked --blades A,C --sides LE",
            "bladescout start hill-3 --vehicle heron --router tls/192.168.1.5:7448 --keys keys/ada",
        ),
        "status": ("bladescout status", "bladescout status --json"),
        "watch": ("bladescout watch", "bladescout watch --all"),
        "console": ("bladescout console --open", "bladescout console --port 8500"),
        "pause": ("bladescout pause",),
        "resume": (
            "bladescout resume",
            "bladescout resume --operator 'A. Person' --rotor-locked",
        ),
        "skip": ("bladescout skip",),
        "stop": ("bladescout stop",),
        "abort": ("bladescout abort",),
    },
    "A site: people, several vehicles": {
        "keys": (
            "bladescout keys keys --vehicle heron=192.168.1.5 --operator ada --viewer eve",
            "bladescout keys keys --remove eve",
        ),
        "farm": ("bladescout farm farm.toml --keys keys/ada",),
        "router": ("bladescout router --keys keys/ground",),
        "live": ("bladescout live --vehicle heron",),
    },
    "After a mission": {
        "report": (
            "bladescout report missions/20261122T095651Z-demo --pdf",
            "bladescout report NEWER --against OLDER",
        ),
        "locate": (
            "bladescout locate PHOTO.jpg 648 486",
            "bladescout locate PHOTO.jpg 648 486 --to 700 486",
        ),
        "verify": ("bladescout verify missions/20261122T095651Z-demo",),
        "export": ("bladescout export missions/20261122T095651Z-demo --to photos",),
        "replay": (
            "bladescout replay missions/20261122T095651Z-demo --only commands",
            "bladescout replay missions/20261122T095651Z-demo --method fermat",
            "bladescout replay hover.pcap --poses hover.csv",
        ),
    },
    "The method": {
        "estimate": (
            "bladescout estimate tests/clouds/ascent.npz",
            "bladescout estimate cloud.ply --viewpoint 15.8,-16.5,66.1 --rotor-diameter 90",
            "bladescout estimate hover.lvx2 --poses hover.tum --json",
        ),
        "bench": (),
    },
}


def lay_out(app: typer.Typer) -> None:
    """Put the commands in their groups and order, and their examples below their help."""
    place = {
        name: (rank, title, examples)
        for rank, (name, title, examples) in enumerate(
            (name, title, examples)
            for title, commands in GROUPS.items()
            for name, examples in commands.items()
        )
    }
    for command in app.registered_commands:
        _, command.rich_help_panel, examples = place[_name(command)]
        word = "Example:" if len(examples) == 1 else "Examples:"
        # A list in Markdown; a blank line between, as the help joins the lines of a paragraph.
        command.epilog = "\n\n".join((word, *(f"- {example}" for example in examples)))
    app.registered_commands.sort(key=lambda command: place[_name(command)][0])
    for group in app.registered_groups:
        group.rich_help_panel = place[str(group.name)][1]


def _name(command: typer.models.CommandInfo) -> str:
    if command.name is not None:
        return command.name
    return "" if command.callback is None else command.callback.__name__.replace("_", "-")
