"""The long cases run when they are asked for; figures are kept where `--figures FILE` says."""

import dataclasses
import json
import math
from datetime import UTC, datetime
from pathlib import Path

import pytest


def pytest_collection_modifyitems(config, items):
    if "faults" in (config.option.markexpr or ""):
        return
    here = Path(__file__).parent
    long = [i for i in items if i.get_closest_marker("faults") and i.path.is_relative_to(here)]
    if long:
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if item not in set(long)]


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
