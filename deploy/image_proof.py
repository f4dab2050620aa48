"""Carry out the Dockerfile's steps without a container engine: each stage in a clean Debian root.

``sudo unshare --mount python3 deploy/image_proof.py /var/tmp/proof`` (needs debootstrap and a
network). Every RUN, COPY, ENV and WORKDIR is done as written, in a root of its own made by
debootstrap, which stands in for the base image; then the daemon is started as the image would
start it, by its user, and the health check is asked. Prints the size of what the last stage holds
beyond its base. Further arguments are paths of this computer that the roots see too (a mirror of
packages, certificates).
"""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: python:3.11-slim is a Debian with a Python beside it; bookworm's own is 3.11 too.
SUITE, PACKAGES = "bookworm", "python3,python3-venv,ca-certificates"
HEALTHY_WITHIN_S = 300.0
_PASSED = ("PIP_", "SSL_CERT_")


@dataclass
class Stage:
    """One stage: its root and what has been set in it."""

    name: str
    root: Path
    environment: dict[str, str] = field(
        default_factory=lambda: {
            "PATH": "/usr/local/bin:/usr/bin:/usr/sbin:/bin:/sbin",
            # As build arguments would be given: where packages come from.
            **{key: value for key, value in os.environ.items() if key.startswith(_PASSED)},
        }
    )
    workdir: str = "/"
    user: str = "0"
    words: dict[str, list[str]] = field(default_factory=dict)

    def inside(self, *command: str, user: str = "0") -> list[str]:
        """Return a command line that runs a command in the root, as the stage has it set."""
        env = [f"{key}={value}" for key, value in self.environment.items()]
        change = ["chroot", f"--userspec={user}:{user}", str(self.root)]
        start = ["sh", "-c", f'cd {self.workdir} && exec "$@"', "-"]
        return [*change, "env", "-i", *env, *start, *command]


def instructions(text: str) -> list[tuple[str, str]]:
    """Return keyword and rest of each instruction, continuation lines joined."""
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    joined = "\n".join(lines).replace("\\\n", " ")
    return [
        (line.split(None, 1)[0], line.split(None, 1)[1].strip())
        for line in joined.splitlines()
        if line.strip()
    ]


def carry_out(folder: Path, shared: list[Path]) -> Stage:
    """Do every step; return the last stage."""
    base = folder / "base"
    if not base.exists():
        run(["debootstrap", "--variant=minbase", f"--include={PACKAGES}", SUITE, str(base)])
        (base / "usr/local/bin/python").symlink_to("/usr/bin/python3")
    stages: list[Stage] = []
    for keyword, rest in instructions((ROOT / "Dockerfile").read_text()):
        say(f"--- {keyword} {rest[:100]}")
        if keyword == "FROM":
            name = rest.split(" AS ")[-1] if " AS " in rest else "last"
            stages.append(Stage(name, folder / name))
            shutil.rmtree(stages[-1].root, ignore_errors=True)
            run(["cp", "--archive", str(base), str(stages[-1].root)])
            furnish(stages[-1].root, shared)
        else:
            step(stages, keyword, rest)
    return stages[-1]


def furnish(root: Path, shared: list[Path]) -> None:
    """Give a root what an engine gives a container: proc, devices, names, and what is shared."""
    run(["mount", "--types", "proc", "proc", str(root / "proc")])
    run(["mount", "--rbind", "/dev", str(root / "dev")])
    shutil.copy("/etc/resolv.conf", root / "etc/resolv.conf")
    for path in shared:
        seen = root / str(path).lstrip("/")
        seen.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            seen.mkdir(exist_ok=True)
        else:
            seen.touch()
        run(["mount", "--bind", str(path), str(seen)])


def step(stages: list[Stage], keyword: str, rest: str) -> None:
    """Do one step in the newest stage."""
    stage = stages[-1]
    if keyword == "RUN":
        run(stage.inside("sh", "-c", rest))
    elif keyword == "COPY":
        copy(stages, shlex.split(rest))
    elif keyword == "ENV":
        for pair in shlex.split(rest):
            key, _, value = pair.partition("=")
            stage.environment[key] = value.replace("$PATH", stage.environment["PATH"])
    elif keyword == "WORKDIR":
        stage.workdir = rest
        (stage.root / rest.lstrip("/")).mkdir(parents=True, exist_ok=True)
    elif keyword == "USER":
        stage.user = rest
    elif keyword in ("ENTRYPOINT", "CMD"):
        stage.words[keyword] = json.loads(rest)
    elif keyword == "HEALTHCHECK":
        stage.words[keyword] = json.loads(rest.split("CMD", 1)[1])
    elif keyword not in ("VOLUME", "STOPSIGNAL"):
        raise SystemExit(f"{keyword}: not known here")


def copy(stages: list[Stage], words: list[str]) -> None:
    """Copy from the sources, without what .dockerignore leaves out, or from an earlier stage."""
    source_root = ROOT
    if words[0].startswith("--from="):
        source_root = next(s.root for s in stages if s.name == words[0].split("=")[1])
        words = words[1:]
    stage, (*sources, target) = stages[-1], words
    into = Path(os.path.normpath(f"{stage.root}/{Path(stage.workdir, target)}"))
    for source in sources:
        found = source_root / source.lstrip("/")
        if found.is_dir():
            ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", ".*_cache")
            shutil.copytree(found, into, symlinks=True, dirs_exist_ok=True, ignore=ignored)
        else:
            shutil.copy(found, into)


def prove(stage: Stage) -> None:
    """Start what the image starts, as its user, until its health check says that it is well."""
    entry = stage.words["ENTRYPOINT"]
    log_file = stage.root.parent / "serve.log"
    with log_file.open("wb") as out:
        daemon = subprocess.Popen(
            stage.inside(*entry, *stage.words["CMD"], user=stage.user),
            stdin=subprocess.DEVNULL, stdout=out, stderr=out,
        )  # fmt: skip
    try:
        begun = time.monotonic()
        check = stage.inside(*stage.words["HEALTHCHECK"], user=stage.user)
        while subprocess.run(check, capture_output=True, check=False).returncode:
            if daemon.poll() is not None or time.monotonic() > begun + HEALTHY_WITHIN_S:
                raise SystemExit(f"the daemon is not well:\n{log_file.read_text()[-2000:]}")
            time.sleep(2.0)
        say(f"healthy after {time.monotonic() - begun:.0f} s, as user {stage.user}")
    finally:
        daemon.terminate()
        daemon.wait(30)


def size_mb(path: Path, without: Collection[Path] = ()) -> float:
    """Return what a folder takes, MB; ``without``: folders below it that are not its own."""
    device, total = path.stat().st_dev, 0
    for folder, names, files in os.walk(path):
        below = [(name, Path(folder, name)) for name in names]
        names[:] = [n for n, at in below if at.lstat().st_dev == device and at not in without]
        total += sum(Path(folder, name).lstat().st_size for name in files)
    return total * 1e-6


def say(words: str) -> None:
    """Tell on standard output, at once."""
    sys.stdout.write(words + "\n")
    sys.stdout.flush()


def run(command: list[str]) -> None:
    """Run a command that must succeed."""
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL)


def main() -> None:
    """Do the steps below the folder that is named, and prove the result."""
    folder, *shared = (Path(word).absolute() for word in sys.argv[1:])
    folder.mkdir(parents=True, exist_ok=True)
    last = carry_out(folder, shared)
    prove(last)
    # What is shared lies elsewhere, and an image of Debian keeps no packages that were unpacked.
    without = [last.root / str(path).lstrip("/") for path in shared]
    for root in (last.root, folder / "base"):
        without += [root / "var/cache/apt", root / "var/lib/apt/lists"]
    own = size_mb(last.root, without) - size_mb(folder / "base", without)
    packages = size_mb(last.root / "opt", without)
    say(f"{own:.0f} MB beyond the base image, {packages:.0f} of them Python's packages")


if __name__ == "__main__":
    main()
