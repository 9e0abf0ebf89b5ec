"""Many recordings are queried through Rerun's own catalog, with the code shown in the docs."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from drop_physics import Analysis, Scenario, analyze, simulate

PAGE = Path(__file__).parents[1] / "docs/catalog.md"
pytestmark = pytest.mark.needs("datafusion")
HERTZ = (960, 480, 240)


@pytest.fixture(scope="module")
def analyses(tmp_path_factory: pytest.TempPathFactory) -> list[Analysis]:
    """Return the analyses of three timesteps, whose recordings are in a folder `drops`."""
    folder = tmp_path_factory.mktemp("catalog") / "drops"
    folder.mkdir()
    results = []
    for hertz in HERTZ:
        simulate(Scenario(timestep_s=1 / hertz), folder / f"{hertz}.rrd", camera=None)
        results.append(analyze(folder / f"{hertz}.rrd", at_s=[0.3]))
    return results


def test_one_query_gets_the_error_at_one_time_of_all_runs(
    analyses: list[Analysis], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = analyses[0].recording
    assert path is not None
    monkeypatch.chdir(path.parents[1])
    (code,) = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    variables: dict[str, Any] = {}
    exec(code, variables)
    for row, hertz, analysis in zip(variables["rows"], HERTZ, analyses, strict=True):
        (moment,) = analysis.at
        assert moment.terms_m is not None
        assert row == {
            "timestep_s": 1 / hertz,
            "error_m": moment.error_m,
            "timestep_m": moment.terms_m.timestep,
            "damping_m": moment.terms_m.damping,
        }


def test_every_scenario_property_is_a_column(analyses: list[Analysis]) -> None:
    import rerun as rr

    path = analyses[0].recording
    assert path is not None
    with rr.server.Server(host="127.0.0.1", datasets={"drops": [path]}) as server:
        assert server.host() == "127.0.0.1"
        table = server.client().get_dataset("drops").segment_table()
        columns = {field.name for field in table.schema()}
    given = {key for key, value in analyses[0].scenario.items() if value is not None}
    assert {f"property:scenario:{key}" for key in given} <= columns
