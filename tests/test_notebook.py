"""The notebook in `docs/` runs, and shows each result once, with its plot and its viewer."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from command import HANGS_S
from drop_physics.recording.viewer import in_notebook

NOTEBOOK = Path(__file__).parents[1] / "docs/examples/arm.ipynb"


@pytest.fixture(scope="module")
def outputs(tmp_path_factory: pytest.TempPathFactory) -> list[list[dict[str, Any]]]:
    """Return the outputs of the notebook's code cells."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(NOTEBOOK, as_version=4)
    folder = {"metadata": {"path": str(tmp_path_factory.mktemp("notebook"))}}
    NotebookClient(notebook, timeout=HANGS_S, resources=folder).execute()
    return [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]


pytestmark = [
    pytest.mark.long,
    *(pytest.mark.needs(module) for module in ("nbclient", "ipykernel", "rerun_notebook")),
]


def test_no_cell_is_empty_but_those_that_only_define(outputs: list[list[dict[str, Any]]]) -> None:
    assert [bool(shown) for shown in outputs[1:]] == [True] * 5
    assert "arm.rrd   721 samples" in outputs[1][0]["data"]["text/plain"]


def test_a_result_is_shown_once_with_its_plot(outputs: list[list[dict[str, Any]]]) -> None:
    (shown,) = outputs[2]
    text, html = shown["data"]["text/plain"], shown["data"]["text/html"]
    assert "lbr_iiwa_joint_2 ends 1.3 rad off its target" in text
    assert html.count("ends 1.3 rad off") == 1
    assert html.count("<img") == 2  # the row of the account, and the plot
    assert max(map(len, text.splitlines())) <= 80
    assert "In[1], line 15\n1  lbr_iiwa_joint_2" in text
    assert '<ol class="findings"' in html
    told = html.partition("<img")[0]
    assert "color" not in told  # its colours are the page's
    assert "font-family: monospace" in told
    assert "lbr_iiwa_joint_4" in told, "a row of the account"


def test_the_arm_holds_with_the_force_that_is_named(outputs: list[list[dict[str, Any]]]) -> None:
    assert outputs[3][0]["text"].startswith("off-target\n")
    assert float(outputs[4][-1]["data"]["text/plain"]) < 1e-2


def test_a_viewer_is_shown_where_it_is_installed(outputs: list[list[dict[str, Any]]]) -> None:
    film, *widgets = [shown["data"] for shown in outputs[5]]
    assert "application/vnd.jupyter.widget-view+json" in widgets[-1]
    assert "data:image/gif" in film["text/html"]  # until the viewer is there, or in its place


def test_a_viewer_opens_at_the_moment_of_a_row(tmp_path: Path) -> None:
    """The time is set after the recording was sent, in nanoseconds of simulated time."""
    recording = tmp_path / "any.rrd"
    recording.write_bytes(b"RRF2")
    sent = [message for message, _ in in_notebook([recording], 100, 1.5)._viewer._event_queue]
    assert [message["type"] for message in sent] == ["rrd", "time_ctrl"]
    assert (sent[1]["timeline"], sent[1]["duration_nanos"]) == ("sim_time", "1500000000")


def test_the_notebook_is_kept_without_outputs() -> None:
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells)
