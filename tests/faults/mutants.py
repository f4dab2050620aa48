"""Mutates the guard, one small change at a time; its tests have to notice each.

``python -m tests.faults.mutants`` prints the survivors, measures which branches the tests take,
and keeps both for SAFETY.md; ``--survivors`` tries only those of the run before, ``--seconds N``
as many, drawn at random, as there is time for. Every mutant runs in a fork of a process that has
loaded all.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import math
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

import pytest

# Loaded here once, so that no fork has to.
import tests.faults.guarding  # noqa: F401
from tests.faults.survivors import REASONS

ROOT = Path(__file__).parents[2]
MODULE = "mission.flight.guard"
FILE = ROOT / "mission/flight/guard.py"
TESTS = (
    "tests/mission/flight/test_guard_bounds.py",
    "tests/mission/flight/test_guard_ways.py",
    "tests/mission/flight/test_guard.py",
)
OUT = Path(__file__).parent / "mutants.json"
PATIENCE_S = 120
#: Of the order in which mutants are tried.
SEED = 30

_COMPARE = {
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,), ast.In: (ast.NotIn,),
}  # fmt: skip
_BINARY = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
           ast.BitOr: ast.BitAnd, ast.MatMult: ast.Sub}  # fmt: skip
_NAMES = {"min": "max", "max": "min", "argmin": "argmax", "argmax": "argmin", "minimum": "maximum",
          "maximum": "minimum", "any": "all", "all": "any"}  # fmt: skip


def _places(tree: ast.Module) -> Iterator[ast.AST]:
    """Yield the nodes that may be mutated: no annotations, no documentation, no imports."""
    skipped: set[int] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.arg | ast.AnnAssign) and node.annotation is not None:
            skipped |= {id(part) for part in ast.walk(node.annotation)}
        if isinstance(node, ast.FunctionDef):
            skipped |= {id(part) for part in ast.walk(node.returns)} if node.returns else set()
            for decorator in node.decorator_list:
                skipped |= {id(part) for part in ast.walk(decorator)}
        if isinstance(node, ast.ClassDef):
            for decorator in node.decorator_list:
                skipped |= {id(part) for part in ast.walk(decorator)}
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(id(node.value))
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "np.einsum":
            skipped.add(id(node.args[0]))
    for node in ast.walk(tree):
        if id(node) not in skipped:
            yield node


def _changes(node: ast.AST) -> Iterator[tuple[str, object]]:
    """Yield what may become of a node: (attribute, new value)."""
    if isinstance(node, ast.Compare):
        for other in _COMPARE.get(type(node.ops[0]), ()):
            yield "ops", [other(), *node.ops[1:]]
    elif isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        yield "op", _BINARY[type(node.op)]()
    elif isinstance(node, ast.BoolOp):
        yield "op", ast.Or() if isinstance(node.op, ast.And) else ast.And()
        if len(node.values) > 2:
            for k in range(len(node.values)):
                yield "values", node.values[:k] + node.values[k + 1 :]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield "op", ast.UAdd()
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        yield "operand", ast.UnaryOp(ast.Not(), node.operand)
    elif isinstance(node, ast.Constant):
        yield from (("value", value) for value in _constants(node.value))
    elif isinstance(node, ast.Attribute) and node.attr in _NAMES:
        yield "attr", _NAMES[node.attr]
    elif isinstance(node, ast.Name) and node.id in _NAMES and isinstance(node.ctx, ast.Load):
        yield "id", _NAMES[node.id]
    elif isinstance(node, ast.If | ast.IfExp):
        yield "test", ast.UnaryOp(ast.Not(), node.test)


def _constants(value: object) -> Iterator[object]:
    if isinstance(value, bool):
        yield not value
    elif isinstance(value, int | float):
        yield value + 1
        if value:
            yield 0.9 * value
    elif isinstance(value, str):
        yield "" if value else "words"


def mutants(source: str) -> Iterator[tuple[str, str]]:
    """Yield (what was changed, the mutated source)."""
    lines, tree = source.splitlines(), ast.parse(source)
    for index, node in enumerate(list(_places(tree))):
        for k, (attribute, _) in enumerate(_changes(node)):
            changed = copy.deepcopy(tree)
            target = list(_places(changed))[index]
            new = list(_changes(target))[k][1]
            setattr(target, attribute, new)
            mutated = ast.unparse(ast.fix_missing_locations(changed))
            if mutated == ast.unparse(tree):
                continue
            line, shown = getattr(node, "lineno", 0), _shown(target)
            yield f"{line}: {lines[line - 1].strip()} -> {shown}", mutated


def _shown(changed: ast.AST) -> str:
    """Return what became of a node: an expression, of an `if` its condition."""
    if isinstance(changed, ast.If | ast.IfExp):
        return ast.unparse(changed.test)
    if isinstance(changed, ast.Constant) and isinstance(changed.value, float):
        return f"{changed.value:.9g}"
    return ast.unparse(changed)


class _Branches(ast.NodeTransformer):
    """Wraps each condition so that it says what it was."""

    def __init__(self) -> None:
        self.conditions: dict[int, str] = {}

    def _noted(self, test: ast.expr) -> ast.expr:
        number = len(self.conditions)
        self.conditions[number] = f"{test.lineno}: {ast.unparse(test)}"
        return ast.Call(ast.Name("_noted", ast.Load()), [ast.Constant(number), test], [])

    def visit_If(self, node: ast.If) -> ast.AST:
        self.generic_visit(node)
        node.test = self._noted(node.test)
        return node

    def visit_IfExp(self, node: ast.IfExp) -> ast.AST:
        self.generic_visit(node)
        node.test = self._noted(node.test)
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        node.values = [self._noted(value) for value in node.values]
        return node


def branches(source: str) -> tuple[int, list[str]]:
    """Return how many outcomes of conditions there are, and those that the tests never see."""
    wrapping = _Branches()
    tree = ast.fix_missing_locations(wrapping.visit(ast.parse(source)))
    with tempfile.NamedTemporaryFile() as kept:
        code = _forked(ast.unparse(tree), notes=Path(kept.name), stop_early=False)
        taken = {tuple(pair) for pair in json.loads(Path(kept.name).read_text())}
    assert code == 0, "the tests fail on the unchanged guard"
    wanted = {(number, outcome) for number in wrapping.conditions for outcome in (False, True)}
    missing = [f"{wrapping.conditions[n]} is never {o}" for n, o in sorted(wanted - taken)]
    return len(wanted), missing


def _forked(source: str, *, notes: Path | None = None, stop_early: bool = True) -> int:
    """Run the guard's tests on a source, in a fork; return pytest's code, -1 for too long."""
    child = os.fork()
    if child == 0:
        code = 70
        try:
            code = _run(source, notes, stop_early)
        finally:
            os._exit(code)
    signal.signal(signal.SIGALRM, lambda *_: os.kill(child, signal.SIGKILL))
    signal.alarm(PATIENCE_S)
    _, status = os.waitpid(child, 0)
    signal.alarm(0)
    return os.WEXITSTATUS(status) if os.WIFEXITED(status) else -1


def _run(source: str, notes: Path | None, stop_early: bool) -> int:
    taken: set[tuple[int, bool]] = set()

    def noted(number: int, value: object) -> object:
        taken.add((number, bool(value)))
        return value

    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    module = ModuleType(MODULE)
    module.__file__ = str(FILE)
    module.__dict__["_noted"] = noted
    sys.modules[MODULE] = module
    vars(sys.modules["mission.flight"])["guard"] = module
    exec(compile(source, str(FILE), "exec"), module.__dict__)
    options = ["-q", "-p", "no:cacheprovider", *(["-x"] if stop_early else [])]
    code = int(pytest.main([*options, *TESTS]))
    if notes is not None:
        notes.write_text(json.dumps(sorted(taken)))
    return code


def _tried(
    changes: list[tuple[str, str]], again: set[str] | None, seconds: float
) -> tuple[int, list[str]]:
    """Return how many mutants were tried in time, and the changes of those that survive."""
    deadline, survivors = time.monotonic() + seconds, []
    for tried, (change, mutated) in enumerate(changes):
        if time.monotonic() > deadline:
            return tried, survivors
        if (again is None or change in again) and _forked(mutated) == 0:
            survivors.append(change)
            sys.stdout.write(f"survives: {change}\n")
            sys.stdout.flush()
    return len(changes), survivors


def main() -> int:
    """Mutate, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--survivors", action="store_true")
    parser.add_argument("--seconds", type=float, default=math.inf)
    options = parser.parse_args()
    os.chdir(ROOT)
    source = FILE.read_text()
    outcomes, missing = branches(source)
    sys.stdout.write(f"{outcomes - len(missing)} of {outcomes} outcomes of conditions seen\n")
    for line in missing:
        sys.stdout.write(f"  {line}\n")
    earlier = json.loads(OUT.read_text()) if options.survivors else None
    again = None if earlier is None else {s["change"] for s in earlier["survivors"]}
    changes = list(mutants(source))
    random.Random(SEED).shuffle(changes)
    tried, survivors = _tried(changes, again, options.seconds)
    reasons = {change: REASONS.get(change.partition(": ")[2], "") for change in survivors}
    unexplained = [change for change, why in reasons.items() if not why]
    kept = {
        "mutants": len(changes),
        "tried": tried,
        "killed": tried - len(survivors),
        "survivors": [{"change": c, "why": why or "not explained"} for c, why in reasons.items()],
        "branches": f"{outcomes - len(missing)} of {outcomes} outcomes of conditions",
        "date": datetime.now(UTC).date().isoformat(),
    }
    OUT.write_text(json.dumps(kept, indent=1) + "\n")
    sys.stdout.write(
        f"{tried} of {len(changes)} tried: {kept['killed']} killed, {len(survivors)} survive, "
        f"{len(unexplained)} unexplained\n"
    )
    return 1 if unexplained or missing else 0


if __name__ == "__main__":
    sys.exit(main())
