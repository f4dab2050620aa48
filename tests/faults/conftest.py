"""The long cases run when they are asked for; figures are kept where `--figures FILE` says."""

import dataclasses
import json
import math
from datetime import UTC, datetime
from pathlib import Path

import pytest


def pytest_collection_modifyitems(config, items):
    here = Path(__file__).parent
    rows = config.getoption("rows", default=None)
    if rows:
        wanted = [words.strip() for words in rows.split(";")]
        left_out = [item for item in items if not any(words in item.name for words in wanted)]
    elif "faults" in (config.option.markexpr or ""):
        left_out = []
    else:
        long = (item for item in items if item.get_closest_marker("faults"))
        left_out = [item for item in long if item.path.is_relative_to(here)]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in set(left_out)]


@pytest.fixture
def measured(request):
    """Keep what was seen of a fault, where the run was asked to."""

    def keep(fault, seen):
        name = request.config.getoption("figures", default=None)
        if not name:
            return
        file = Path(name)
        kept = json.loads(file.read_text()) if file.exists() else {}
        figures = dataclasses.asdict(seen)
        figures["events"] = sorted(seen.events)
        for key, value in figures.items():
            if isinstance(value, float):
                figures[key] = round(value, 3) if math.isfinite(value) else None
        figures["date"] = datetime.now(UTC).date().isoformat()
        kept[fault.key] = figures
        file.write_text(json.dumps(dict(sorted(kept.items())), indent=1) + "\n")

    return keep
